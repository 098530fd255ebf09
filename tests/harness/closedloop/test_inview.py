"""Where a vehicle can be put that stands ahead, who is a leader in plain view, and a sensor that seldom detects one."""

from types import SimpleNamespace

import numpy as np
import pytest

from harness.closedloop.beliefs import believed_by_each
from harness.closedloop.inview import SeldomDetected, leader_in_view, stands_ahead
from harness.sensor.detector import build_sensor
from harness.sensor.profiles import sensor_settings
from harness.truth.network.demand import Drivers
from harness.truth.network.network import load_network
from harness.truth.sumo.population import draw_vehicle
from mmpf.map.corridor_road import highway
from tests.harness.closedloop.frames import frame_of

pytestmark = pytest.mark.usefixtures("no_shadows")
US101, ROAD = load_network("us101"), highway()
LIDAR = sensor_settings("lidar", {})
CAR = draw_vehicle(np.random.default_rng(0), Drivers())
MIDDLE_M = 9.15
EGO_M = 50.0


def on_us101(lon, lat, lat_speed=None, speed=20.0):
    """Return traffic on US-101 whose first car, the ego, drives on the upstream edge in the middle lane."""
    count = 1 + len(lon)
    columns = {"lat_speed_mps": np.append(0.0, lat_speed or np.zeros(count - 1))}
    frame = frame_of(
        [EGO_M, *lon], [MIDDLE_M, *lat], np.full(count, speed), names=["ego", *"abc"[: count - 1]], **columns
    )
    vehicle = SimpleNamespace(getRoadID=lambda _: "upstream", getLaneIndex=lambda _: 2)
    return SimpleNamespace(
        frames=[frame], network=US101, running=SimpleNamespace(sumo=SimpleNamespace(vehicle=vehicle)), step_s=0.1
    )


def stands(traffic, flow_mps=20.0, range_m=100.0):
    return stands_ahead(traffic, 0, range_m, CAR, flow_mps)


def test_it_stands_in_the_egos_lane_just_out_of_range():
    placement = stands(on_us101([], []))
    # The edge "upstream" begins at -40 m.
    rear_m = -40.0 + placement.position_m - CAR.length_m
    assert (placement.edge, placement.lane_index) == ("upstream", 2)
    assert rear_m - (EGO_M + 2.25) == pytest.approx(110.0, abs=1e-3)


def test_on_an_edge_with_a_further_lane_on_the_right_it_is_the_same_main_lane():
    placement = stands(on_us101([], []), range_m=150.0)
    assert (placement.edge, placement.lane_index) == ("auxiliary", 3)


@pytest.mark.parametrize(
    ("lon", "lat", "lat_speed"),
    [([120.0], [MIDDLE_M], [0.0]), ([170.0], [MIDDLE_M + 0.5], [0.0]), ([120.0], [MIDDLE_M + 3.66], [-0.8])],
)
def test_it_stands_nowhere_where_somebody_is_between_or_comes_there(lon, lat, lat_speed):
    assert stands(on_us101(lon, lat, lat_speed)) is None


def test_those_beside_behind_and_far_ahead_are_not_between():
    assert stands(on_us101([120.0, 20.0, 230.0], [MIDDLE_M + 3.66, MIDDLE_M, MIDDLE_M])) is not None


def test_the_ego_is_part_of_the_flow_and_the_place_within_the_section():
    assert stands(on_us101([], [], speed=16.0)) is None
    assert stands(on_us101([], [], speed=16.0), flow_mps=None) is not None
    assert stands(on_us101([], []), range_m=600.0) is None


def in_view(lon, lat, **columns):
    """Return who is the leader in plain view of the first of some cars."""
    count = len(lon)
    lane = ROAD.lane_number_at(np.asarray(lon, dtype=float), np.asarray(lat, dtype=float))
    frames = [frame_of(lon, lat, np.full(count, 10.0), step, lane=lane, **columns) for step in range(51)]
    traffic = SimpleNamespace(frames=frames, network=SimpleNamespace(road=ROAD))
    belief = believed_by_each(frames[-1], np.array([0]), ROAD)
    return leader_in_view(traffic, belief, 0, 0, LIDAR)


def test_the_leader_is_who_is_right_ahead_near_and_in_plain_view():
    assert in_view([0.0, 25.0, 50.0], [1.8, 1.8, 1.8]) == "v1"
    assert in_view([0.0, 60.0], [1.8, 1.8]) == ""
    assert in_view([0.0, 25.0], [1.8, 5.5]) == ""
    # Where one in the lane beside hides it in part it is in no plain view.
    assert in_view([0.0, 40.0, 27.0], [1.8, 3.6, 4.7], width_m=np.array([1.8, 1.8, 2.5])) == ""
    assert in_view([0.0, 40.0, 27.0], [1.8, 3.6, 5.7], width_m=np.array([1.8, 1.8, 2.5])) == "v1"


def looks(share, seed):
    sensor = build_sensor(LIDAR)
    if share is not None:
        sensor = SeldomDetected(sensor, "v1", share, LIDAR)
    frames = [frame_of([0.0, 25.0, 25.0], [1.8, 1.8, 5.5], step=step) for step in range(400)]
    return [sensor.observe(frame, ROAD, np.random.default_rng((seed, frame.step))) for frame in frames]


@pytest.mark.slow
def test_one_vehicle_is_detected_in_a_share_of_the_scans_and_nothing_else_changes():
    usual, seldom = looks(None, 4), looks(0.35, 4)

    def share_of(name, observations):
        return np.mean([(each.truth_id == name).any() for each in observations])

    # Four standard deviations of 400 draws are 0.1.
    assert share_of("v1", seldom) == pytest.approx(0.35 * share_of("v1", usual), abs=0.1)
    assert share_of("v2", seldom) == share_of("v2", usual)
    for before, after in zip(usual, seldom, strict=True):
        kept = before.truth_id[np.isin(before.truth_id, after.truth_id)]
        assert kept.tolist() == after.truth_id.tolist()
        assert len(after.scan.detections.lon_m) == len(after.truth_id) == len(after.detection_visible_fraction)
    assert SeldomDetected(build_sensor(LIDAR), "v1", 0.35, LIDAR).model(ROAD) == build_sensor(LIDAR).model(ROAD)
