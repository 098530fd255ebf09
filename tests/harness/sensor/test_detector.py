from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from harness.sensor.detector import build_sensor
from harness.sensor.profiles import sensor_profiles, sensor_settings
from harness.storage.schema import HIDDEN, OUT, PARTIAL, VISIBLE
from mmpf.map.corridor_road import CorridorRoad, highway
from mmpf.scan import CAR, TRUCK, VEHICLE_CLASSES
from tests.harness.sensor.sensor_scenes import MIDDLE, ROAD, frame_of

pytestmark = pytest.mark.usefixtures("no_shadows")
SURE = {"detection_probability": 1.0, "clutter_per_scan": 0.0}
# Independent errors of vehicles that are all detected, and reports that say what holds in plain view.
STEADY = {
    **SURE,
    "missed_far_share": 0.0,
    "persistent_clutter": 0.0,
    "merged_share": 0.0,
    "split_share": 0.0,
    "reported_factor": 1.0,
    "reported_spread": 0.0,
}


def look(frame, profile="lidar-independent", seed=0, road=ROAD, **overrides):
    sensor = build_sensor(sensor_settings(profile, overrides))
    return sensor.observe(frame, road, np.random.default_rng(seed))


def looks(frame, count, profile="lidar-independent", seed=0, **overrides):
    """Return independent looks at a frame: each is an episode of its own, at whose start the sensor forgets."""
    sensor, rng = build_sensor(sensor_settings(profile, overrides)), np.random.default_rng(seed)
    return [sensor.observe(replace(frame, episode=k), ROAD, rng) for k in range(count)]


# In each quadrant four vehicles, none of which hides another, between 14 and 90 m away; two of them trucks.
AHEAD = [(12.0, 7.0), (24.0, 7.0), (48.0, 7.0), (90.0, 7.0)]
PLAIN = frame_of(*[(way * lon, side * lat) for way in (1, -1) for side in (1, -1) for lon, lat in AHEAD])
PLAIN = replace(
    PLAIN,
    length_m=np.array([4.7] + 2 * [4.1, 4.4, 4.7, 18.0, 3.9, 4.3, 5.1, 4.6]),
    width_m=np.array([1.9] + 2 * [1.7, 1.8, 1.9, 2.5, 1.6, 1.7, 2.0, 2.1]),
)
FAR = np.hypot(PLAIN.lon_m - 300.0, PLAIN.lat_m - MIDDLE) > 40.0
# The same pair ahead and behind; the nearer hides a part of the farther.
PAIRS = frame_of((20, 0), (40, 1.4), (-20, 0), (-40, 1.4))


@cache
def errors_in_plain_view(profile):
    """Return the vehicle and the error in reported deviations of each detection of ``PLAIN``: places, and sizes."""
    vehicles, places, sizes = [], [], []
    for seen in looks(PLAIN, 80, profile, **STEADY):
        assert seen.visible_fraction == pytest.approx(np.ones(17))
        d = seen.scan.detections
        of = np.array([int(name.removeprefix("car")) for name in seen.truth_id])
        vehicles.append(of)
        places.append([(d.lon_m - PLAIN.lon_m[of]) / d.std_lon_m, (d.lat_m - PLAIN.lat_m[of]) / d.std_lat_m])
        if d.sizes is not None:
            settings = sensor_settings(profile, {})
            # What is reported gives no true size away.
            assert d.sizes.std_length_m == pytest.approx(settings.std_length_m, abs=1e-4)
            assert d.sizes.std_width_m == pytest.approx(settings.std_width_m, abs=1e-4)
            sizes.append(
                [
                    (d.sizes.length_m - PLAIN.length_m[of]) / d.sizes.std_length_m,
                    (d.sizes.width_m - PLAIN.width_m[of]) / d.sizes.std_width_m,
                ]
            )
    joined = [np.concatenate(part, axis=-1) for part in (places, sizes) if part]
    return np.concatenate(vehicles), np.concatenate(joined)


def test_of_two_cars_in_line_only_the_nearer_is_detected():
    seen = look(frame_of((30, 0), (50, 0)), **SURE)
    assert seen.truth_id.tolist() == ["car1"]
    assert seen.state.tolist() == [VISIBLE, VISIBLE, HIDDEN]
    assert seen.occluder.tolist() == [-1, -1, 1]
    assert seen.visible_fraction == pytest.approx([1.0, 1.0, 0.0])


def test_a_car_behind_the_ego_is_seen_as_well_as_one_ahead():
    ahead, behind = look(frame_of((30, 3)), **STEADY), look(frame_of((-30, 3)), **STEADY)
    assert ahead.truth_id.tolist() == behind.truth_id.tolist() == ["car1"]
    assert ahead.scan.detections.std_lon_m == pytest.approx(behind.scan.detections.std_lon_m, rel=1e-3)


def test_the_ego_is_neither_detected_nor_in_its_own_way():
    seen = look(frame_of((10, 0)), **SURE)
    assert seen.truth_id.tolist() == ["car1"]
    assert seen.state[0] == VISIBLE
    assert seen.visible_fraction[0] == 1.0
    assert seen.occluder.tolist() == [-1, -1]


@cache
def partly_hidden():
    """Return looks at ``PAIRS``, the visible fraction of its farther cars, and their rows in each look."""
    seen = looks(PAIRS, 500, clutter_per_scan=0.0)
    assert {int(state) for s in seen for state in s.state[[2, 4]]} == {PARTIAL}
    ahead, behind = seen[0].visible_fraction[[2, 4]]
    assert 0.15 < ahead < 0.7
    assert behind == pytest.approx(ahead)
    return seen, ahead, [np.isin(s.truth_id, ["car2", "car4"]) for s in seen]


@pytest.mark.slow
def test_a_partly_hidden_car_is_in_the_partial_state_and_rarer_and_noisier():
    seen, fraction, rows = partly_hidden()
    hits, chances = sum(map(np.count_nonzero, rows)), 2 * len(seen)
    expected = 0.95 * fraction / 0.7
    assert hits / chances == pytest.approx(expected, abs=4 * np.sqrt(expected * (1 - expected) / chances))
    alone = look(frame_of((40, 1.4)), **STEADY).scan.detections.std_lon_m[0]
    errors = np.concatenate([abs(s.scan.detections.lon_m[r] - 300.0) - 40.0 for s, r in zip(seen, rows, strict=True)])
    assert np.std(errors) / alone == pytest.approx(1 + 2 * (0.7 - fraction) / 0.55, rel=4 / np.sqrt(2 * hits))


def test_beyond_the_range_nothing_is_detected_but_a_truck_that_reaches_in_still_hides():
    frame = frame_of((101, 0), (98.9, 3.66), (99.5, 0.3))
    frame = replace(frame, length_m=np.array([4.7, 16.0, 4.7, 1.0]))
    seen = look(frame, **SURE)
    assert seen.state.tolist() == [VISIBLE, OUT, VISIBLE, HIDDEN]
    assert seen.in_range.tolist() == [True, False, True, True]
    assert seen.visible_fraction[1] == 0.0
    assert seen.occluder.tolist() == [-1, -1, -1, 1]
    assert seen.truth_id.tolist() == ["car2"]


def test_a_forward_sensor_sees_nothing_behind_it():
    seen = look(frame_of((30, 0), (-30, 0), (0.5, 9)), field_of_view_deg=90.0, **SURE)
    assert seen.truth_id.tolist() == ["car1"]
    assert seen.state.tolist() == [VISIBLE, VISIBLE, OUT, OUT]


@pytest.mark.slow
def test_without_detections_only_clutter_is_left_and_its_number_is_poisson():
    counts = []
    for seen in looks(frame_of((30, 0)), 300, detection_probability=0.0, clutter_per_scan=3.0):
        assert set(seen.truth_id) <= {""}
        assert np.isnan(seen.detection_visible_fraction).all()
        counts.append(len(seen.truth_id))
    assert np.mean(counts) == pytest.approx(3.0, abs=4 * np.sqrt(3.0 / 300))
    assert np.var(counts) == pytest.approx(3.0, rel=0.25)


def test_clutter_spreads_evenly_over_the_lanes_in_range():
    seen = look(frame_of(), clutter_per_scan=1000.0, range_m=60.0)
    lon, lat = seen.scan.detections.lon_m - 300.0, seen.scan.detections.lat_m
    assert (np.hypot(lon, lat - MIDDLE) <= 60.001).all()
    assert (ROAD.lane_number_at(lon + 300.0, lat) > 0).all()
    per_lane = np.bincount(ROAD.lane_number_at(lon + 300.0, lat), minlength=6)[1:]
    assert per_lane == pytest.approx(np.full(5, len(lon) / 5), abs=4 * np.sqrt(len(lon) / 5))
    assert np.mean(lon > 0) == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(len(lon)))


def test_a_forward_sensor_has_clutter_only_ahead():
    seen = look(frame_of(), clutter_per_scan=50.0, field_of_view_deg=90.0)
    detections = seen.scan.detections
    assert (np.abs(np.arctan2(detections.lat_m - MIDDLE, detections.lon_m - 300.0)) <= np.pi / 4 + 1e-3).all()


def test_the_data_sheet_spreads_clutter_over_the_road_in_range():
    sheet = build_sensor(sensor_settings("lidar", {"range_m": 80.0})).model()
    assert sheet.clutter_area_m2 == pytest.approx(2 * 80 * 5 * 3.66)
    assert sheet.range_m == 80.0


def assert_standard_normal(errors):
    assert errors.mean(axis=-1) == pytest.approx(np.zeros(len(errors)), abs=4 / np.sqrt(errors.shape[1]))
    assert (errors**2).mean(axis=-1) == pytest.approx(np.ones(len(errors)), abs=4 * np.sqrt(2 / errors.shape[1]))


@pytest.mark.parametrize(
    "profile",
    [
        pytest.param(name, marks=() if name == "lidar" else pytest.mark.slow)
        for name in sensor_profiles
        if sensor_settings(name, {}).field_of_view_deg == 360.0
    ],
)
def test_told_to_report_exactly_a_sensor_reports_the_deviations_of_its_errors_in_plain_view(profile):
    vehicle, errors = errors_in_plain_view(profile)
    for some in (FAR[vehicle], ~FAR[vehicle]):
        assert_standard_normal(errors[:2, some])


@pytest.mark.parametrize("profile", ["lidar", "lidar-independent", "camera"])
def test_sizes_are_off_by_the_reported_deviation_which_gives_no_true_size_away(profile):
    vehicle, errors = errors_in_plain_view(profile)
    is_truck = PLAIN.length_m[vehicle] > 10.0
    for some in (is_truck, ~is_truck):
        assert_standard_normal(errors[2:, some])


def test_sizes_of_a_partly_hidden_vehicle_are_noisier_by_the_same_factor_as_its_place():
    seen, fraction, rows = partly_hidden()
    widths = np.concatenate([s.scan.detections.sizes.width_m[r] for s, r in zip(seen, rows, strict=True)])
    factor = 1 + 2 * (0.7 - fraction) / 0.55
    std = factor * sensor_settings("lidar-independent", {}).std_width_m
    assert np.std(widths) == pytest.approx(std, rel=4 / np.sqrt(2 * len(widths)))


def test_length_and_width_err_independently_of_each_other_and_of_the_place():
    _, errors = errors_in_plain_view("lidar-independent")
    assert np.abs(np.corrcoef(errors) - np.eye(4)).max() < 4 / np.sqrt(errors.shape[1])


def test_a_radar_measures_no_sizes_and_clutter_looks_like_a_car_to_those_that_do():
    assert look(frame_of((30, 0)), "radar", clutter_per_scan=20.0).scan.detections.sizes is None
    ghosts = look(frame_of(), clutter_per_scan=500.0).scan.detections.sizes
    for measured, true in ((ghosts.length_m, 4.7), (ghosts.width_m, 1.9)):
        assert measured.mean() == pytest.approx(true, abs=4 * 0.1 * true / np.sqrt(len(measured)))
        assert measured.std() == pytest.approx(0.1 * true, rel=0.15)


def test_whether_sizes_are_measured_changes_no_place():
    frame = frame_of((30, 0), (-20, -4))
    with_sizes, without = look(frame, **SURE), look(frame, std_length_m=None, std_width_m=None, **SURE)
    assert without.scan.detections.sizes is None
    assert with_sizes.scan.detections.lon_m.tobytes() == without.scan.detections.lon_m.tobytes()


def test_no_box_is_smaller_than_a_box_can_be():
    frame = replace(frame_of((30, 0)), length_m=np.array([4.7, 0.4]), width_m=np.array([1.9, 0.4]))
    for seed in range(100):
        look(frame, seed=seed, std_length_m=9.0, std_width_m=4.0, **SURE).scan.detections.validate()


def test_a_camera_knows_the_bearing_well_and_the_range_badly():
    seen = look(frame_of((80, 0)), "camera", **STEADY).scan.detections
    assert seen.std_lon_m[0] > 3.0
    assert seen.std_lat_m[0] < 0.5


def test_noise_grows_with_range():
    near, far = (look(frame_of((x, 8)), **STEADY).scan.detections for x in (20, 95))
    assert far.std_lat_m[0] > near.std_lat_m[0]


def test_only_the_radar_measures_speed_and_not_across_its_line_of_sight():
    cars = frame_of((30, 0, 12.0), (-50, 5, 31.0), (1, 7, 20.0))
    seen = look(cars, "radar", **STEADY)
    by_id = dict(zip(seen.truth_id, seen.scan.detections.speed_mps, strict=True))
    assert by_id["car1"] == pytest.approx(12.0, abs=0.5)
    assert by_id["car2"] == pytest.approx(31.0, abs=0.5)
    assert np.isnan(by_id["car3"])
    assert np.isnan(look(cars, "lidar", **STEADY).scan.detections.speed_mps).all()


def test_speed_errors_have_the_reported_deviation_for_cars_that_drift_as_usual():
    frame = frame_of((30, 25), (30, -25), (-30, 25), (-30, -25))
    sensor, rng = build_sensor(sensor_settings("radar", STEADY)), np.random.default_rng(0)
    errors, stds = [], []
    for k in range(200):
        sideways = np.append(0.0, rng.normal(0, 0.35, 4))
        detections = sensor.observe(replace(frame, episode=k, lat_speed_mps=sideways), ROAD, rng).scan.detections
        errors.append(detections.speed_mps - 20.0)
        stds.append(detections.std_speed_mps)
    assert np.std(errors) == pytest.approx(np.mean(stds), rel=0.1)


def test_the_order_of_the_detections_says_nothing_of_the_vehicles():
    frame = frame_of(*[(12.0 * k, 7.0 * (k % 2) - 3.5) for k in (-4, -3, -2, -1, 1, 2, 3, 4)])
    first = [seen.truth_id[0] for seen in looks(frame, 300, clutter_per_scan=0.0)]
    seen_first = np.unique(first, return_counts=True)[1]
    assert len(seen_first) >= 6
    assert seen_first.max() < 300 / 3


def test_the_sight_settings_do_not_shift_the_draws_of_the_vehicles():
    frame = frame_of((30, 0), (-20, -4))
    full = look(frame, detection_probability=1.0, clutter_per_scan=0.0)
    crowded = look(frame, detection_probability=1.0, clutter_per_scan=5.0)
    lon = dict(zip(crowded.truth_id, crowded.scan.detections.lon_m, strict=True))
    assert {i: lon[i] for i in full.truth_id} == dict(zip(full.truth_id, full.scan.detections.lon_m, strict=True))


def test_a_turn_of_the_whole_road_changes_no_observation():
    turned = replace(highway(), reference_xy=((100.0, -50.0), (100.0 + np.cos(2.5), -50.0 + np.sin(2.5))))
    frame = frame_of((20, 0), (40, 1.4), (-30, -6), heading=0.02)
    straight, other = look(frame, seed=3), look(frame, seed=3, road=turned)
    assert other.visible_fraction == pytest.approx(straight.visible_fraction, abs=1e-9)
    assert other.scan.detections.lon_m == pytest.approx(straight.scan.detections.lon_m, abs=2e-4)
    assert other.scan.detections.lat_m == pytest.approx(straight.scan.detections.lat_m, abs=2e-4)


def test_on_a_bend_a_car_in_the_same_lane_need_not_hide_the_next():
    angle = np.linspace(0, np.pi / 2, 60)
    bend = CorridorRoad(
        lanes=highway().lanes, reference_xy=tuple(zip(60 * np.sin(angle), 60 - 60 * np.cos(angle), strict=True))
    )
    frame = frame_of((20, 0), (40, 0), ego_lon=10.0)
    assert look(frame).state[2] == HIDDEN
    assert look(frame, road=bend).state[2] == VISIBLE


positions = st.lists(st.tuples(st.floats(-150, 150), st.floats(-9, 9)), max_size=12)


@settings(max_examples=60, deadline=None)
@given(positions, st.sampled_from(list(sensor_profiles)), st.integers(0, 1000))
@example([(0.0, 1.25), (3.0, 1.5)], "lidar-real", 0)
def test_any_traffic_gives_a_valid_and_consistent_observation(cars, profile, seed):
    frame = frame_of(*cars)
    seen = look(frame, profile, seed)
    seen.scan.detections.validate()
    count = len(seen.scan.detections)
    assert seen.truth_id.shape == seen.detection_visible_fraction.shape == (count,)
    assert set(seen.truth_id) <= set(frame.vehicle_id[1:]) | {""}
    assert len(set(seen.truth_id) - {""}) == np.count_nonzero(seen.truth_id != "")
    assert ((seen.visible_fraction >= 0) & (seen.visible_fraction <= 1)).all()
    assert ((seen.state == OUT) == ~seen.in_range).all()
    real = np.flatnonzero(seen.truth_id != "")
    assert (seen.detection_visible_fraction[real] >= sensor_profiles[profile]().hidden_fraction).all()


def test_scores_are_calibrated_and_change_no_detection():
    many = {**STEADY, "clutter_per_scan": 20.0}
    plain, scored = (looks(PLAIN, 100, "lidar", **many, score_separation=by) for by in (0.0, 2.0))
    for one, other in zip(plain, scored, strict=True):
        assert one.scan.detections.score is None
        assert np.array_equal(one.scan.detections.lon_m, other.scan.detections.lon_m)
    score = np.concatenate([each.scan.detections.score for each in scored])
    true = np.concatenate([each.truth_id != "" for each in scored])
    among = (score > 0.65) & (score < 0.75)
    odds = among[true].mean() / among[~true].mean()
    assert odds / (1.0 + odds) == pytest.approx(0.7, abs=0.06)


def test_classes_are_right_as_often_as_the_data_sheet_says_and_change_no_detection():
    frame = replace(PLAIN, vehicle_class=np.where(PLAIN.length_m > 10.0, TRUCK, CAR))
    plain, told = (looks(frame, 100, "lidar", **STEADY, class_accuracy=by) for by in (0.0, 0.8))
    for one, other in zip(plain, told, strict=True):
        assert one.scan.detections.vehicle_class is None
        assert np.array_equal(one.scan.detections.lon_m, other.scan.detections.lon_m)
    found = np.concatenate([each.scan.detections.vehicle_class for each in told])
    of = np.concatenate([each.truth_id for each in told])
    true = {name: int(kind) for name, kind in zip(frame.vehicle_id, frame.vehicle_class, strict=True)}
    of_truck = np.array([true.get(name, CAR) == TRUCK for name in of])
    assert build_sensor(sensor_settings("lidar", {"class_accuracy": 0.8})).model().class_accuracy == 0.8
    for chosen, right in ((of_truck, TRUCK), (~of_truck, CAR)):
        shares = np.bincount(found[chosen], minlength=len(VEHICLE_CLASSES)) / chosen.sum()
        assert shares == pytest.approx([0.0] + [0.8 if k == right else 0.05 for k in range(1, 6)], abs=0.05)
    assert looks(PLAIN, 1, "lidar", **STEADY, class_accuracy=0.8)[0].scan.detections.vehicle_class is None
