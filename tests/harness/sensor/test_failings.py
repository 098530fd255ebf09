"""Failings that last: their rates and runs in long scenes, held against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingClassifier, HistGradientBoostingRegressor
from sklearn.metrics import r2_score, roc_auc_score
from threadpoolctl import threadpool_limits

from harness.sensor.detector import build_sensor
from harness.sensor.memory import Chain, next_state
from harness.sensor.profiles import sensor_settings
from harness.sensor.returns import _seen_fractions
from harness.sensor.scene import Scene, sight_to
from tests.harness.sensor.sensor_scenes import CALM, RING, RING_NAMES, ROAD, film, frame_of

STEP_S = 0.1
pytestmark = [pytest.mark.usefixtures("no_shadows"), pytest.mark.slow]


def run_lengths(flags):
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(flags, dtype=int), [0]])))
    return edges[1::2] - edges[::2]


@pytest.mark.parametrize(("share", "run_s"), [(0.05, 0.4), (0.15, 0.8), (0.5, 1.0), (0.2, 0.01)])
def test_a_chain_has_its_share_and_its_mean_run(share, run_s):
    rng = np.random.default_rng(0)
    state, history = np.full(300, np.nan), []
    for _ in range(800):
        state = next_state(Chain(share, run_s), state, STEP_S, rng.random(300)).astype(float)
        history.append(state)
    history = np.array(history)
    assert history.mean() == pytest.approx(share, rel=0.05)
    runs = np.concatenate([run_lengths(column) for column in history.T])
    # Independent draws have runs of 1 / (1 - share) steps; none can be shorter.
    assert runs.mean() * STEP_S == pytest.approx(max(run_s, STEP_S / (1 - share)), rel=0.05)


def errors(frame, scans, **settings):
    """Return by how much each car's detections are off along the road, shape (scans, cars)."""
    seen = [dict(zip(s.truth_id, s.scan.detections.lon_m, strict=True)) for s in film([frame] * scans, **settings)]
    return np.array([[row[name] for name in RING_NAMES] for row in seen]) - frame.lon_m[1:]


def missed(frame, scans, **settings):
    """Return in which scans each car is missed, shape (scans, cars)."""
    return np.array([[name not in s.truth_id for name in RING_NAMES] for s in film([frame] * scans, **settings)])


def test_bursts_take_their_share_of_time_and_last_as_long_as_asked_for():
    found = missed(frame_of(*RING), 150, **CALM, burst_share=0.15, burst_s=0.8)
    assert found.mean() == pytest.approx(0.15, abs=0.04)
    lengths = np.concatenate([run_lengths(column) for column in found.T])
    assert lengths.mean() * STEP_S == pytest.approx(0.8, rel=0.25)


def test_runs_of_misses_leave_the_share_of_misses_as_it_is():
    often = {"clutter_per_scan": 0.0, "detection_probability": 0.8}
    single, runs = (missed(frame_of(*RING), 120, **often, missed_in_runs=share) for share in (0.0, 0.9))
    assert single.mean() == pytest.approx(0.2, abs=0.02)
    assert runs.mean() == pytest.approx(0.2, abs=0.03)
    assert np.concatenate([run_lengths(column) for column in runs.T]).mean() > 2 * 1.25


def test_a_partly_hidden_or_distant_vehicle_is_missed_oftener():
    frame = frame_of((20, 0), (40, 1.4), (-30, 3.66), (-97, -3.66))
    seen = film([frame] * 250, "lidar", clutter_per_scan=0.0, persistent_clutter=0.0)
    share = [np.mean([f"car{k}" not in s.truth_id for s in seen]) for k in range(1, 5)]
    assert share[1] > share[2]
    assert share[3] > share[2]


def test_errors_drift_as_fast_and_as_much_as_asked_for():
    settings = {"std_range_m": 0.0, "std_bearing_deg": 0.0}
    error = errors(frame_of(*RING), 150, **CALM, bias_share=0.6, bias_time_s=0.5, **settings)
    assert error.std() == pytest.approx(0.3, rel=0.08)
    for lag in (1, 3, 6):
        correlation = np.corrcoef(error[lag:].ravel(), error[:-lag].ravel())[0, 1]
        assert correlation == pytest.approx(0.6 * np.exp(-lag * STEP_S / 0.5), abs=0.06)


def test_without_drift_errors_are_independent_from_scan_to_scan():
    error = errors(frame_of(*RING), 30, **CALM)
    correlation = np.corrcoef(error[1:].ravel(), error[:-1].ravel())[0, 1]
    assert correlation == pytest.approx(0.0, abs=4 / np.sqrt(30 * 36))


def lasting(number, life_s, moving):
    """Return settings by which nothing is detected but so many false objects, each in every scan."""
    figures = {"": number, "_s": life_s, "_probability": 1.0, "_moving": moving}
    nothing = {"detection_probability": 0.0, "clutter_per_scan": 0.0}
    return nothing | {f"persistent_clutter{name}": value for name, value in figures.items()}


def test_false_objects_stay_for_their_mean_life_and_have_their_number():
    seen = film([frame_of((30, 0))] * 400, **lasting(6.0, 0.5, 0.0))
    numbers = np.array([len(s.truth_id) for s in seen], dtype=float)
    assert numbers.mean() == pytest.approx(6.0, rel=0.15)
    # The number present in an M/G/infinity queue is correlated as lives go on: exp(-lag / life).
    for lag_s in (0.2, 0.5):
        lag = int(lag_s / STEP_S)
        assert np.corrcoef(numbers[lag:], numbers[:-lag])[0, 1] == pytest.approx(np.exp(-lag_s / 0.5), abs=0.2)
    assert all(set(s.truth_id) <= {""} for s in seen)


def test_what_moves_among_false_objects_moves_with_the_traffic():
    for seed in range(20):
        seen = film([frame_of((30, 0, 12.0))] * 15, seed=seed, **lasting(1.0, 1e6, 1.0))
        if all(len(s.truth_id) == 1 for s in seen):
            places = np.array([s.scan.detections.lon_m[0] for s in seen])
            if np.ptp(places) < 50.0:
                assert np.polyfit(STEP_S * np.arange(15), places, 1)[0] == pytest.approx(12.0, abs=1.0)
                return
    raise AssertionError("no run with one false object")


def test_a_split_truck_gives_two_boxes_of_which_one_stands_for_it():
    frame = frame_of((30, 0))
    frame = replace(frame, length_m=np.array([4.7, 16.0]))
    seen = film([frame] * 250, **CALM, split_share=0.2, split_s=0.3)
    double = np.array([len(s.truth_id) == 2 for s in seen])
    assert double.mean() == pytest.approx(0.2, abs=0.09)
    assert all(sorted(s.truth_id) in (["car1"], ["", "car1"]) for s in seen)
    both = next(s for s, two in zip(seen, double, strict=True) if two).scan.detections
    assert both.sizes.length_m.sum() == pytest.approx(16.0, abs=3.0)
    assert len(film([frame_of((30, 0))] * 30, **CALM, split_share=0.9)[-1].truth_id) == 1


def test_two_cars_close_together_become_one_box_over_both_and_others_never_do():
    close = film([frame_of((20, 2.5), (20, 5.4))] * 250, **CALM, merged_share=0.3, merged_s=0.3, merged_gap_m=1.5)
    single = [s for s in close if len(s.truth_id) == 1]
    # Either of the two would merge with probability 0.3.
    assert len(single) / len(close) == pytest.approx(1 - 0.7**2, abs=0.12)
    assert np.mean([s.scan.detections.sizes.width_m[0] for s in single]) == pytest.approx(2.9 + 1.9, abs=0.2)
    apart = film([frame_of((20, 2.5), (-20, 2.5))] * 30, **CALM, merged_share=0.9)
    assert all(len(s.truth_id) == 2 for s in apart)


def test_the_box_of_a_partly_hidden_car_recedes_from_who_hides_it():
    frame = frame_of((20, 0), (40, 1.4))
    steady, shifted = (
        np.mean(
            [
                s.scan.detections.lat_m[s.truth_id == "car2"][0] - frame.lat_m[2]
                for s in film([frame] * 100, **CALM, centre_shift_share=share, view_exponent=0.0)
            ]
        )
        for share in (0.0, 1.0)
    )
    hidden = 1 - film([frame])[0].visible_fraction[2]
    assert steady == pytest.approx(0.0, abs=0.2)
    assert shifted - steady == pytest.approx(0.5 * hidden * 1.9, rel=0.3)


def test_late_detections_are_those_of_the_truth_at_that_time():
    sensors = [build_sensor(sensor_settings("lidar-independent", CALM | {"latency_s": s})) for s in (0.0, 0.3)]
    seen = []
    for sensor in sensors:
        rng, frame = np.random.default_rng(1), frame_of((30, 0))
        seen.append(
            [
                sensor.observe(replace(frame, step=k, time_s=0.1 * k, lon_m=frame.lon_m + 2.0 * k), ROAD, rng)
                for k in range(12)
            ]
        )
    now, late = seen
    assert [len(s.truth_id) for s in late[:3]] == [0, 0, 0]
    for k in range(3, 12):
        assert late[k].scan.time_s == now[k].scan.time_s
        assert late[k].scan.detections.lon_m.tobytes() == now[k - 3].scan.detections.lon_m.tobytes()
        assert late[k].visible_fraction.tobytes() == now[k].visible_fraction.tobytes()


def test_an_ideal_sensor_sees_whoever_is_not_hidden_and_nothing_else():
    rng = np.random.default_rng(0)
    for seed in range(10):
        cars = np.stack([rng.uniform(-90, 90, 25), 3.66 * rng.integers(-2, 3, 25) + rng.normal(0, 0.3, 25)], axis=-1)
        frame = frame_of(*cars.tolist())
        for seen in film([frame] * 5, "ideal", seed=seed):
            there = seen.in_range & (seen.visible_fraction >= 0.16)
            there[frame.ego] = False
            assert sorted(seen.truth_id) == sorted(frame.vehicle_id[there])


@pytest.mark.parametrize("profile", ["ideal", "lidar", "lidar-independent", "radar", "camera"])
def test_equal_seeds_give_equal_bytes_over_a_run_and_a_new_episode_forgets(profile):
    frame = frame_of((30, 0), (34, 3.0), (-20, -4), (50, 1.5))
    one, two = (film([frame] * 30, profile, seed=5, latency_s=0.1) for _ in range(2))
    for first, second in zip(one, two, strict=True):
        assert first.scan.detections.lon_m.tobytes() == second.scan.detections.lon_m.tobytes()
        assert first.scan.detections.std_lon_m.tobytes() == second.scan.detections.std_lon_m.tobytes()
    sensor, rng = build_sensor(sensor_settings(profile, {"latency_s": 0.1})), np.random.default_rng(0)
    for k in range(5):
        sensor.observe(replace(frame, time_s=0.1 * k), ROAD, rng)
    assert not len(sensor.observe(replace(frame, time_s=0.5, episode=1), ROAD, rng).truth_id)


@pytest.fixture(scope="module", params=["lidar", "lidar-independent"])
def reports(request):
    """Return what thousands of true detections report of themselves, their visible fractions, and what clutter does."""
    rng = np.random.default_rng(3)
    sensor, stream = build_sensor(sensor_settings(request.param, {"clutter_per_scan": 4.0})), np.random.default_rng(4)
    told, fractions = [], []
    for k in range(250):
        lanes = 3.66 * rng.integers(-2, 3, 30)
        cars = np.stack([rng.uniform(-95, 95, 30), lanes + rng.normal(0, 0.3, 30)], axis=-1)
        seen = sensor.observe(replace(frame_of(*cars.tolist()), time_s=0.1 * k, episode=k), ROAD, stream)
        d = seen.scan.detections
        told.append(np.stack([d.std_lon_m, d.std_lat_m, d.sizes.std_length_m, d.sizes.std_width_m], axis=-1))
        fractions.append(seen.detection_visible_fraction)
    told, fractions = np.concatenate(told), np.concatenate(fractions)
    true = np.flatnonzero(~np.isnan(fractions))
    return told[true], fractions[true], told[np.isnan(fractions)]


def test_reported_deviations_hardly_tell_how_much_of_a_vehicle_is_seen(reports):
    told, fraction, _ = reports
    assert len(told) >= 2500
    assert fraction.std() > 0.15
    half = len(told) // 2
    model = HistGradientBoostingRegressor(max_depth=4, max_iter=80, random_state=0)
    with threadpool_limits(1):
        model.fit(told[:half], fraction[:half])
        assert r2_score(fraction[half:], model.predict(told[half:])) < 0.3


def test_clutter_reports_deviations_as_true_detections_do(reports):
    told, _, false = reports
    count = min(len(told), len(false))
    rows = np.concatenate([told[:count], false[:count]])
    is_false = np.repeat([0, 1], count)
    order = np.random.default_rng(0).permutation(2 * count)
    train, held_out = np.array_split(order, 2)
    model = HistGradientBoostingClassifier(max_depth=3, max_iter=50, random_state=0)
    with threadpool_limits(1):
        model.fit(rows[train], is_false[train])
        assert roc_auc_score(is_false[held_out], model.predict_proba(rows[held_out])[:, 1]) < 0.6


def test_clutter_looks_like_the_vehicles_in_sight_of_which_the_ego_is_none():
    frame = frame_of((20, 0), (40, 1.4))
    sight = sight_to(frame.lon_m, frame.lat_m, ROAD, frame.ego_pose, 0.0)
    lidar = sensor_settings("lidar", {})
    scene = Scene(lidar, frame, ROAD, sight, np.array([1.0, 0.4, 0.05]), np.full(3, -1), np.ones(3, dtype=bool))
    assert _seen_fractions(scene).tolist() == [0.4]
