"""Which cars can be the ego of an episode in which a hidden vehicle occupies the gap that the route needs."""

from types import SimpleNamespace

import numpy as np

from harness.closedloop.changing import lane_middle_m
from harness.closedloop.gaps import Occupied
from harness.decisions.decide import driver_of
from harness.sensor.profiles import sensor_settings
from mmpf.map.road import highway
from tests.harness.closedloop.frames import frame_of

ROAD = highway()
OWN, BESIDE = (lane_middle_m(ROAD, lane, 0.0) for lane in (3, 2))
FRAMES = 51
SENSOR = sensor_settings("lidar", {})


def traffic(closing_mps=8.0, hidden_now=True, always=False):
    """A fast car in the lane beside comes up behind a truck that follows the ego."""
    frames = []
    for step in range(FRAMES):
        left_s = 0.1 * (FRAMES - 1 - step)
        truck_m = -9.5 if always or (hidden_now and left_s < 1.5) else -60.0
        lon = [0.0, truck_m, -33.0 - (0.0 if always else closing_mps * left_s)]
        frames.append(
            frame_of(
                lon, [OWN, OWN, BESIDE], [10.0, 10.0, 10.0 + closing_mps], step=step, names=["ego", "truck", "fast"],
                length_m=[4.5, 9.0, 4.5], width_m=[1.8, 2.5, 1.8], lane=[3, 3, 2],
            )
        )  # fmt: skip
    network = SimpleNamespace(road=ROAD, ego_lanes=(2, 3, 4))
    return SimpleNamespace(frames=frames, network=network, step_s=0.1)


def found(of):
    return Occupied(of, driver_of("hdm"), np.array([0])).by_hidden(0, SENSOR)


def test_a_fast_car_that_a_truck_hides_occupies_the_gap_beside_the_ego():
    assert found(traffic()) == ("fast", 2)


def test_one_in_plain_view_one_that_was_never_in_sight_and_one_that_leaves_room_do_not():
    assert found(traffic(hidden_now=False)) == ("", 0)
    assert found(traffic(always=True)) == ("", 0)
    assert found(traffic(closing_mps=0.0)) == ("", 0)
