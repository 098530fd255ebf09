"""Fits are reproducible, recovery labels lead back, and counted accelerations are those of a plain loop."""

from dataclasses import replace

import numpy as np

from harness.lab.fit.driver_fit import FEWEST, demonstrated_samples, fit_empirical, recovery_samples
from harness.lab.fit.mixture_em import fit_mixture
from harness.lab.windows.neighbours import NeighbourStates
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


def steady_following(count=80, steps=60):
    """Followers at speeds of their own, each 1.5 s and 2 m behind a leader as fast."""
    rng = np.random.default_rng(1)
    speed = np.repeat(rng.uniform(5.0, 25.0, (count, 1)), steps, axis=1)
    still, lon = np.zeros((count, steps)), STEP_S * speed * np.arange(steps)
    led = windows(count, rng)
    length = led.leader.length_m[:, :steps]
    leader = NeighbourStates(lon + 1.5 * speed + 2.0 + length, speed, still, length)
    return replace(led, lon_m=lon, speed_mps=speed, accel_mps2=still, leader=leader)


HABIT = np.full(80, np.log(1.5))


def test_who_is_too_near_is_told_to_slow_down_and_who_is_too_far_to_speed_up():
    x, y = recovery_samples(steady_following(), HABIT, 5000, np.random.default_rng(2))
    astray = np.exp(x[:, 0]) - (1.5 * (x[:, 1] - x[:, 3]) + 2.0)
    still = np.abs(x[:, 3]) < 0.3
    change = y[:, 0] - x[:, 2]
    calm = still & (np.abs(x[:, 2]) < 0.1)
    assert change[calm & (astray < -3.0)].mean() < 0.0
    assert change[calm & (astray > 3.0)].mean() > 0.0


def test_demonstrated_behaviour_closes_the_gap_again(monkeypatch):
    monkeypatch.setattr("harness.lab.fit.driver_fit.PERTURBED_SHARE", 1.0)
    led = steady_following()
    rng = np.random.default_rng(3)
    model = fit_mixture(*recovery_samples(led, HABIT, 3000, rng), 3, seed=0)
    speed, accel, astray = led.speed_mps[:, 0].copy(), np.zeros(80), np.full(80, 2.0)
    for _ in range(300):
        x = np.column_stack(
            [np.log(1.5 * led.speed_mps[:, 0] + 2.0 - astray), speed, accel, speed - led.speed_mps[:, 0], 0 * speed]
        )
        accel = model.mean(np.column_stack([x, HABIT]))[:, 0]
        astray += STEP_S * (speed + 0.5 * STEP_S * accel - led.speed_mps[:, 0])
        speed = speed + STEP_S * accel
    assert np.abs(astray).mean() < 1.0
    x, y = demonstrated_samples(led, HABIT, model, 20, rng)
    assert x.shape[1] == 6
    assert np.isfinite(y).all()


def test_a_cell_with_enough_moments_spans_what_was_recorded_in_it():
    led = windows(40, np.random.default_rng(0), pull=0.5)
    table = fit_empirical(led)
    now = slice(None, -1)
    columns = (led.gap_m, led.speed_mps, led.accel_mps2, led.leader.speed_mps, led.leader.accel_mps2)
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
