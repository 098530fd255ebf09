"""Fits are reproducible, recovery labels lead back, and counted accelerations are those of a plain loop."""

import numpy as np

from harness.lab.fit.driver_fit import FEWEST, fit_empirical
from harness.lab.fit.mixture_em import fit_mixture
from harness.lab.fit.recovery import FollowingRecords, demonstrated_samples, recovery_samples
from mmpf.motion.learned.features import situation
from tests.harness.lab.fit.test_unrolled import windows

STEP_S = 0.1


def three_clusters(n=1500):
    rng = np.random.default_rng(0)
    kind = rng.integers(3, size=n)
    x = np.array([-4.0, 0.0, 4.0])[kind, None] + 0.3 * rng.normal(size=(n, 1))
    y = np.array([1.0, -2.0, 3.0])[kind, None] + 0.5 * x + 0.1 * rng.normal(size=(n, 1))
    return x, y


def test_the_same_seed_fits_the_same_mixture():
    x, y = three_clusters()
    first, second = fit_mixture(x, y, 3, seed=7), fit_mixture(x, y, 3, seed=7)
    np.testing.assert_array_equal(first.mixture.means, second.mixture.means)
    np.testing.assert_array_equal(first.mixture.covariances, second.mixture.covariances)


def test_a_fitted_mixture_predicts_each_clusters_line():
    fitted = fit_mixture(*three_clusters(), components=3, seed=0)
    np.testing.assert_allclose(fitted.mean(np.array([[-4.0], [0.0], [4.0]]))[:, 0], [-1.0, -2.0, 5.0], atol=0.05)


def test_inputs_beyond_the_training_range_are_taken_for_its_edge():
    x, y = three_clusters()
    fitted = fit_mixture(x, y, 3, seed=0)
    np.testing.assert_allclose(fitted.mean(np.array([[1e6]])), fitted.mean(fitted.scaling.input_high[None]))


def steady_records(windows=80, steps=60):
    shape = (windows, steps)
    rng = np.random.default_rng(1)
    speed = np.repeat(rng.uniform(5.0, 25.0, (windows, 1)), steps, axis=1)
    return FollowingRecords(
        gap_m=1.5 * speed + 2.0,
        speed_mps=speed,
        accel_mps2=np.zeros(shape),
        leader_speed_mps=speed,
        leader_accel_mps2=np.zeros(shape),
        habit=np.full((windows, 1), np.log(1.5)),
        step_s=STEP_S,
    )


def test_who_is_too_near_is_told_to_slow_down_and_who_is_too_far_to_speed_up():
    samples = recovery_samples(steady_records(), 5000, np.random.default_rng(2))
    astray = np.exp(samples.x[:, 0]) - (1.5 * (samples.x[:, 1] - samples.x[:, 3]) + 2.0)
    still = np.abs(samples.x[:, 3]) < 0.3
    change = samples.y[:, 0] - samples.x[:, 2]
    calm = still & (np.abs(samples.x[:, 2]) < 0.1)
    assert change[calm & (astray < -3.0)].mean() < 0.0
    assert change[calm & (astray > 3.0)].mean() > 0.0


def test_demonstrated_behaviour_closes_the_gap_again(monkeypatch):
    monkeypatch.setattr("harness.lab.fit.recovery.PERTURBED_SHARE", 1.0)
    records = steady_records()
    rng = np.random.default_rng(3)
    samples = recovery_samples(records, 3000, rng)
    model = fit_mixture(samples.x, samples.y, 3, seed=0)
    speed, accel, astray = records.speed_mps[:, 0].copy(), np.zeros(80), np.full(80, 2.0)
    for _ in range(300):
        x = np.column_stack(
            [
                np.log(1.5 * records.speed_mps[:, 0] + 2.0 - astray),
                speed,
                accel,
                speed - records.speed_mps[:, 0],
                0 * speed,
            ]
        )
        accel = model.mean(np.column_stack([x, records.habit]))[:, 0]
        astray += STEP_S * (speed + 0.5 * STEP_S * accel - records.speed_mps[:, 0])
        speed = speed + STEP_S * accel
    assert np.abs(astray).mean() < 1.0
    reached = demonstrated_samples(records, model, 20, rng)
    assert reached.x.shape[1] == 6
    assert np.isfinite(reached.y).all()


def test_a_cell_with_enough_moments_spans_what_was_recorded_in_it():
    led = windows(40, np.random.default_rng(0), pull=0.5)
    table = fit_empirical(led)
    now = slice(None, -1)
    columns = (led.gap_m, led.speed_mps, led.accel_mps2, led.leader_speed_mps, led.leader_accel_mps2)
    cell = table.cells(situation(*(column[:, now].ravel() for column in columns)).T)
    change = np.diff(led.accel_mps2, axis=1).ravel()
    rows = table.changes_mps2.reshape(-1, table.changes_mps2.shape[-1])
    checked = 0
    for number in np.unique(cell):
        recorded = change[cell == number]
        assert np.isfinite(rows[number]).all()
        if len(recorded) >= FEWEST:
            np.testing.assert_allclose(rows[number, [0, -1]], [recorded.min(), recorded.max()], atol=6e-4)
            checked += 1
    assert checked > 10
