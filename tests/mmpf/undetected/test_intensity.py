"""How many vehicles to expect where nobody was ever seen."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr

from mmpf.map.control import NO_SIGNAL, YIELD, LinkControl
from mmpf.map.corridor_road import highway
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map
from mmpf.numerics.arrays import taken
from mmpf.scan import Detections, EgoPose, Scan, SensorModel
from mmpf.tracks import CONFIRMED, HIDDEN, TENTATIVE, Tracks
from mmpf.undetected.intensity import QUEUE_M, QUEUED, UnseenOptions, UnseenTraffic
from mmpf.visibility.range_profile import Reach
from tests.mmpf.map.scenes import graph_of
from tests.mmpf.scenes import tracks_of

ROAD = highway(lanes=3, lane_width_m=3.6)
NO_DETECTIONS = Detections(*[np.zeros(0)] * 6)
OPTIONS = UnseenOptions(density_per_km=20.0, headway_std_s=0.0)


def scan(time_s, lon_m=300.0, speed_mps=20.0):
    return Scan(time_s, NO_DETECTIONS, EgoPose(lon_m + speed_mps * time_s, 1.8, 0.0, speed_mps, 4.7, 1.9))


def tracks(*vehicles, time_s=0.0, **columns):
    """Vehicles as (id, metres ahead, lateral place), all at 20 m/s beside the ego."""
    number, ahead, lat = np.array(vehicles, dtype=float).reshape(-1, 3).T
    return tracks_of(300.0 + 20.0 * time_s + ahead, lat, track_id=number, std_lat_m=0.2, std_speed_mps=0.5, **columns)


SENSOR = SensorModel()


def driven(vehicles, seconds=3.0, sensor=SENSOR, **kind):
    unseen = UnseenTraffic(ROAD, sensor, OPTIONS)
    for time_s in np.arange(round(10 * seconds)) / 10:
        told = unseen.step(scan(time_s), tracks(*vehicles, time_s=time_s, **kind))
    return told, told.cells.lon_m - 300.0 - 20.0 * time_s


def test_on_an_open_road_nobody_is_expected():
    told, _ = driven([])
    assert told.expected.sum() < 0.05


def test_a_sensor_that_sees_nothing_expects_the_usual_traffic_everywhere_but_around_the_ego():
    told, ahead = driven([], sensor=SensorModel(detection_probability=0.0))
    per_m = told.expected / told.cells.length_m
    room_m = OPTIONS.room_m + OPTIONS.headway_s * 20.0
    away = (np.abs(ahead) > room_m + 5.0) | (told.cells.lane < 3)
    assert np.ptp(per_m[away]) < 1e-9
    assert per_m[~away & (np.abs(ahead) < room_m - 2.0)].max() < 1e-9


def test_vehicles_are_expected_behind_one_that_hides_them_and_not_before_it():
    told, ahead = driven([(1, 12.0, 5.4)])
    beside = told.cells.lane == 1
    shadow = beside & (ahead > 20.0) & (ahead < 36.0)
    assert told.expected[shadow].sum() > 0.015
    assert told.expected[(told.cells.lane == 3) & (ahead > 20.0)].sum() < 0.02
    assert told.expected[beside & (ahead < 0.0)].sum() < 0.02


@pytest.mark.parametrize("state", [CONFIRMED, HIDDEN])
def test_where_a_vehicle_is_known_there_is_no_room_for_another(state):
    hidden = (2, 28.0, 9.0)
    with_it, ahead = driven([(1, 12.0, 5.4), hidden], state=state)
    without, _ = driven([(1, 12.0, 5.4)], state=state)
    there = (with_it.cells.lane == 1) & (np.abs(ahead - 28.0) < 5.0)
    assert with_it.expected[there].sum() < 0.05 * without.expected[there].sum()


def test_a_tentative_track_takes_up_no_room():
    told, _ = driven([(1, 12.0, 5.4)], state=TENTATIVE)
    nobody, _ = driven([])
    np.testing.assert_allclose(told.expected, nobody.expected)


def test_a_hidden_track_that_is_let_go_leaves_its_vehicle_behind():
    blind = SensorModel(detection_probability=0.0)
    unseen, other = UnseenTraffic(ROAD, blind, OPTIONS), UnseenTraffic(ROAD, blind, OPTIONS)
    hidden = tracks((7, 40.0, 9.0), state=HIDDEN, existence=0.8, std_lon_m=6.0)
    unseen.step(scan(0.0), hidden)
    other.step(scan(0.0), tracks())
    gained = unseen.step(scan(0.1), tracks()).expected.sum() - other.step(scan(0.1), tracks()).expected.sum()
    assert gained == pytest.approx(0.8, abs=0.05)


def left_in_plain_view(scans, reach=None, **options):
    """Expected vehicles per metre of an empty lane beside a standing ego, over the density of traffic, by scan."""
    still = {"settled_s": 0.0, "spread_m2_per_s": 0.0, "mixing_s": 1e9, **options}
    unseen, left = UnseenTraffic(ROAD, SENSOR, UnseenOptions(**still)), []
    for step in range(scans):
        density_per_m = unseen.density_per_km / 1e3
        told = unseen.step(scan(0.1 * step, speed_mps=0.0), tracks(), reach)
        at = np.hypot(told.cells.lon_m - 315.0, told.cells.lat_m - 5.4).argmin()
        left.append(told.expected[at] / told.cells.length_m[at] / density_per_m)
    return np.array(left)


@pytest.mark.parametrize(("share", "run_s"), [(0.0, 0.8), (0.12, 0.8), (0.3, 2.0)])
def test_who_is_in_a_run_of_misses_stays_overlooked_until_it_ends(share, run_s):
    ends = 1.0 - np.exp(-0.1 / (run_s * (1.0 - share)))
    chain = np.array([[1.0 - ends * share, ends * (1.0 - share)], [ends * share, 1.0 - ends * (1.0 - share)]])
    state, expected = np.array([1.0 - share, share]), []
    for step in range(10):
        state = (chain @ state if step else state) * [1.0 - SENSOR.detection_probability, 1.0]
        expected.append(state.sum())
    assert left_in_plain_view(10, run_share=share, run_s=run_s) == pytest.approx(np.array(expected), rel=1e-6)


def test_where_a_tracker_has_learned_that_its_sensor_sees_less_more_is_left():
    rings = np.full(10, 1e6)
    half = Reach(SENSOR.range_m / 10, expected=rings, detected=0.5 * rings)
    missed = 1.0 - 0.5 * SENSOR.detection_probability
    assert left_in_plain_view(4, half, run_share=0.0) == pytest.approx(missed ** np.arange(1, 5), rel=1e-3)


def test_the_density_is_learned_from_the_traffic_that_is_known():
    dense = [(number, ahead, 1.8 + 3.6 * lane) for number, (ahead, lane) in enumerate(
        (ahead, lane) for ahead in np.arange(-57.0, 58.0, 15.0) for lane in (0, 1, 2) if abs(ahead) > 8 or lane
    )]  # fmt: skip
    unseen = UnseenTraffic(ROAD, SensorModel(), OPTIONS)
    for time_s in np.arange(150) / 10:
        unseen.step(scan(time_s), tracks(*dense, time_s=time_s))
    assert unseen.density_per_km == pytest.approx(1e3 / 15.0, rel=0.15)


@pytest.mark.parametrize("speed_mps", [0.0, 10.0, 25.0])
def test_the_faster_a_vehicle_drives_the_farther_is_the_next_in_its_lane(speed_mps):
    unseen = UnseenTraffic(ROAD, SensorModel(detection_probability=0.0), OPTIONS)
    one = replace(tracks((1, 40.0, 5.4)), speed_mps=np.array([speed_mps]))
    told = unseen.step(scan(0.0, speed_mps=0.0), one)
    away = np.abs(told.cells.lon_m - 340.0)
    in_lane = told.cells.lane == told.cells.lane[np.hypot(away, told.cells.lat_m - 5.4).argmin()]
    room_m = OPTIONS.room_m + OPTIONS.headway_s * speed_mps
    assert away[in_lane & (told.expected < 0.01)].max() <= room_m + 2.5
    assert away[in_lane & (told.expected > 0.05)].min() >= room_m - 2.5


def test_drivers_differ_in_the_headway_that_they_keep():
    options = UnseenOptions(density_per_km=20.0, headway_std_s=0.4)
    unseen = UnseenTraffic(ROAD, SensorModel(detection_probability=0.0), options)
    told = unseen.step(scan(0.0), replace(tracks((1, 40.0, 5.4), std_lon_m=0.0), speed_mps=np.array([20.0])))
    per_m = told.expected / told.cells.length_m
    at_m = told.cells.lon_m - 340.0 - (options.room_m + 20.0 * options.headway_s)
    beside = told.cells.lane == 2
    near = beside & (np.abs(at_m) < 16.0)
    np.testing.assert_allclose(per_m[near] / per_m[told.cells.lane == 1].max(), ndtr(at_m[near] / 8.0), atol=1e-3)


def test_before_a_stop_line_more_are_expected():
    graph = graph_of(
        {"to": [(-150.0, 0.0), (0.0, 0.0)], "on": [(0.0, 0.0), (150.0, 0.0)]},
        links=[("to", "on")],
        speed_limit_mps=10.0,
    )
    nobody = np.zeros(0, dtype=np.int64)
    control = LinkControl(np.array([YIELD]), np.full(1, NO_SIGNAL), (), nobody, np.zeros(2, dtype=np.int64))
    road = LaneGraphRoad(graph=replace(graph, control=control))
    unseen = UnseenTraffic(road, SensorModel(detection_probability=0.0), OPTIONS)
    told = unseen.step(Scan(0.0, NO_DETECTIONS, EgoPose(0.0, 30.0, 0.0, 10.0, 4.7, 1.9)), Tracks.none())
    per_m = told.expected / told.cells.length_m
    queues = (told.cells.lon_m > -QUEUE_M) & (told.cells.lon_m < 0.0)
    np.testing.assert_allclose(per_m[queues], QUEUED * per_m[~queues].mean())
    assert np.ptp(per_m[~queues]) < 1e-12


def test_the_order_of_the_tracks_means_nothing():
    vehicles = [(1, 12.0, 5.4), (2, 30.0, 1.8), (3, -20.0, 9.0)]
    one, _ = driven(vehicles)
    other, _ = driven(vehicles[::-1])
    np.testing.assert_allclose(one.expected, other.expected, rtol=1e-9, atol=1e-12)


def test_what_is_expected_is_finite_and_not_negative_whatever_the_tracks_say():
    rng = np.random.default_rng(0)
    unseen = UnseenTraffic(ROAD, SensorModel(), OPTIONS)
    for time_s in np.cumsum(rng.uniform(0.05, 1.0, 60)):
        some = tracks(*[(k, rng.uniform(-150, 150), rng.uniform(-3, 14)) for k in range(rng.integers(0, 12))])
        some = replace(some, std_lon_m=rng.uniform(0.0, 20.0, len(some)), speed_mps=rng.uniform(-5, 40, len(some)))
        told = unseen.step(scan(time_s, speed_mps=float(rng.uniform(0, 40))), taken(some, np.arange(len(some))))
        assert np.isfinite(told.expected).all()
        assert (told.expected >= 0.0).all()


def test_without_a_map_nothing_is_expected_anywhere():
    unseen = UnseenTraffic(LaneGraphRoad(graph=without_map()), SensorModel())
    for time_s in (0.0, 0.1):
        assert len(unseen.step(scan(time_s), tracks((1, 12.0, 5.4))).expected) == 0


def test_what_is_hidden_in_the_first_moments_is_not_forgotten_since_no_track_told_of_it_yet():
    """A tracker needs some scans before it has a track of the vehicle that hides others."""
    found_late = UnseenTraffic(ROAD, SENSOR, OPTIONS)
    for time_s in np.arange(12) / 10:
        vehicles = [(1, 12.0, 5.4)] if time_s >= 0.3 else []
        late = found_late.step(scan(time_s), tracks(*vehicles, time_s=time_s))
    known, _ = driven([(1, 12.0, 5.4)], seconds=1.2)
    np.testing.assert_allclose(late.expected, known.expected, atol=0.01)
    assert known.expected.sum() > 0.05
