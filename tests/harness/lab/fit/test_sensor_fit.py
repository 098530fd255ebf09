"""The fit of a sensor to detections on record finds figures that are known, on drives that are made up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import ks_2samp

from harness.config.sensor import SensorSettings
from harness.lab.fit.sensor_figures import (
    Ghostly,
    area_under_curve,
    chances,
    distance,
    drawn,
    fit_detection,
    fit_drift,
    fit_ghosts,
    lives_drawn,
)
from harness.lab.fit.sensor_fit import main
from harness.lab.fit.sensor_records import FalseObjects, Looks, false_objects_of, fractions_of, gap_steps, looks_of
from harness.truth.recorded.detected.drive import Drive, EgoPath, GivenBoxes, Labels

STEPS = 12


def drive_of(labels: list[tuple[int, int, float, float]], given: list[tuple[int, float, float]]) -> Drive:
    """Return a drive of labels (thing, step, x, y) and detections (step, x, y), boxes of 4 m by 2 m along x."""
    labels = sorted(labels, key=lambda row: row[1])
    thing, step, x, y = (np.array(column) for column in zip(*labels, strict=True))
    box = np.zeros(len(x)), np.full(len(x), 4.0), np.full(len(x), 2.0)
    yes = np.ones(len(x), dtype=bool)
    found = sorted(given)
    at, gx, gy = (np.array(column, dtype=float) for column in zip(*found, strict=True))
    boxes = np.zeros(len(at)), np.full(len(at), 4.0), np.full(len(at), 2.0)
    still = np.zeros(STEPS)
    return Drive(
        "made up",
        EgoPath(still, still, still),
        np.array(["a", "b", "c"]),
        Labels(step, x.astype(float), y.astype(float), *box, thing, yes, ~yes),
        GivenBoxes(at.astype(np.int64), gx, gy, *boxes, np.ones(len(at))),
    )


def looks(found: np.ndarray, fraction: np.ndarray, steps: int) -> Looks:
    """Return looks at vehicles that are labelled for so many steps each."""
    count = len(found)
    vehicle = np.arange(count) // steps
    nothing = np.full(count, np.nan)
    return Looks(
        vehicle, np.arange(count) % steps, np.full(count, 20.0), fraction, found, nothing, nothing, nothing, nothing
    )


def test_what_was_found_of_whom_and_how_far_off():
    labels = [(0, k, 20.0, 0.0) for k in range(STEPS)] + [(1, k, 40.0, 0.0) for k in range(STEPS) if k != 5]
    given = [(k, 20.5, -0.25) for k in range(STEPS) if k not in (3, 4, 8)] + [(2, 40.0, 0.0), (2, -30.0, 9.0)]
    found = looks_of([drive_of(labels, given)], range_m=100.0)
    # The second one's labels pause, so that it counts as two.
    assert np.bincount(found.vehicle).tolist() == [12, 5, 6]
    assert found.found.sum() == len(given) - 1
    assert gap_steps(found, found.found).tolist() == [2, 1]
    first = found.found & (found.vehicle == 0)
    assert found.along_m[first] == pytest.approx(0.5)
    assert found.across_m[first] == pytest.approx(-0.25)
    assert found.fraction[found.vehicle == 0].min() == 1.0
    assert found.fraction[found.vehicle == 1].max() == 0.0


def test_half_a_box_behind_another_is_half_visible():
    # Behind the first box's corner lies half of the second one's silhouette, as rays from the sensor have it.
    drive = drive_of([(0, 0, 20.0, 0.0), (1, 0, 60.0, 3.0)], [(0, 20.0, 0.0)])
    angles = np.arctan2([2.0, 4.0, 2.0, 4.0], [58.0, 58.0, 62.0, 62.0])
    low, high, shadow = angles.min(), angles.max(), np.arctan2(1.0, 18.0)
    known = np.clip((high - shadow) / (high - low), 0.0, 1.0)
    assert fractions_of(drive).tolist() == pytest.approx([1.0, known])


def test_false_boxes_are_linked_into_objects():
    walks = [(k, -30.0 + 1.0 * k, 5.0) for k in range(10) if k not in (4, 5)]
    flash = [(6, 10.0, -20.0)]
    chains = false_objects_of([drive_of([(0, 0, 20.0, 0.0)], walks + flash)])
    assert sorted(zip(chains.life_steps.tolist(), chains.boxes.tolist(), strict=True)) == [(1, 1), (10, 8)]


def test_the_distance_of_samples_is_kolmogorovs():
    rng = np.random.default_rng(3)
    first, second = rng.geometric(0.3, 200), rng.geometric(0.5, 300)
    assert distance(first, second) == pytest.approx(ks_2samp(first, second).statistic)


def test_detection_that_is_known_is_found_again():
    rng = np.random.default_rng(1)
    fraction = rng.uniform(0.05, 1.0, 20_000)
    known = SensorSettings(detection_probability=0.9, view_exponent=0.6, full_view_fraction=0.7, hidden_fraction=0.02)
    plain = looks(np.ones(len(fraction), dtype=bool), fraction, 40)
    probability = chances(known, plain)
    made = looks(rng.random(len(fraction)) < probability, fraction, 40)
    fitted = fit_detection(made, SensorSettings(hidden_fraction=0.02))
    assert chances(fitted, made) == pytest.approx(probability, abs=0.03)


def test_runs_of_misses_are_as_long_as_the_sensors():
    fraction = np.ones(60_000)
    made = looks(np.ones(len(fraction), dtype=bool), fraction, 300)
    sensor = SensorSettings(detection_probability=0.8, missed_in_runs=1.0, missed_run_s=0.5)
    found = drawn(sensor, made, seed=2)
    assert found.mean() == pytest.approx(0.8, abs=0.02)
    assert gap_steps(made, found).mean() == pytest.approx(5.0, rel=0.1)
    alone = drawn(SensorSettings(detection_probability=0.8), made, seed=2)
    # Misses one by one are geometric.
    assert gap_steps(made, alone).mean() == pytest.approx(1.0 / 0.8, rel=0.03)


def test_ghosts_that_are_known_are_found_again():
    known = Ghostly(flashes=0.4, life_s=1.0, probability=0.7)
    lives = lives_drawn(known, seed=5)
    chains = FalseObjects(lives, np.maximum(np.rint(0.7 * (lives - 2)) + 2, 1).astype(np.int64))
    found = fit_ghosts(chains, seed=6)
    assert found.probability == pytest.approx(0.7, abs=0.03)
    assert distance(lives_drawn(found, 7), lives) < 0.04
    assert found.life_s == pytest.approx(1.0, abs=0.31)


def test_errors_that_drift_are_told_from_those_that_are_new():
    rng = np.random.default_rng(8)
    vehicles, steps, share, time_s = 300, 60, 0.6, 0.7
    drift = rng.standard_normal((vehicles, 1))
    rows = [drift[:, 0]]
    kept = np.exp(-0.1 / time_s)
    for _ in range(steps - 1):
        rows.append(kept * rows[-1] + np.sqrt(1.0 - kept**2) * rng.standard_normal(vehicles))
    error = np.sqrt(share) * np.array(rows).T + np.sqrt(1.0 - share) * rng.standard_normal((vehicles, steps))
    made = looks(np.ones(vehicles * steps, dtype=bool), np.ones(vehicles * steps), steps)
    found_share, found_time_s = fit_drift(replace(made, along_m=error.ravel()))
    assert found_share == pytest.approx(share, abs=0.1)
    assert found_time_s == pytest.approx(time_s, abs=0.21)


def test_the_area_under_the_curve_is_the_share_of_pairs_in_the_right_order():
    rng = np.random.default_rng(9)
    fraction, seen = np.round(rng.random(60), 1), rng.random(60) < 0.5
    pairs = [(a > b) + 0.5 * (a == b) for a in fraction[seen] for b in fraction[~seen]]
    assert area_under_curve(fraction, seen) == pytest.approx(np.mean(pairs))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--kitti", "nowhere", "--v2v4real", "x", "--held-out-v2v4real", "x"], "nowhere"),
        (["--kitti", "x", "--v2v4real", "x", "--held-out-v2v4real", "x", "--seed", "5"], "--seed 5"),
    ],
)
def test_wrong_input_is_told_in_one_line(arguments, told, capsys):
    with pytest.raises(SystemExit) as refusal:
        main(arguments)
    assert refusal.value.code == 2
    assert told in capsys.readouterr().err.splitlines()[-1]
