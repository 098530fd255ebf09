"""Which cars can be the ego of an episode in which a hidden car has right of way."""

from types import SimpleNamespace

import numpy as np
import pytest

from harness.closedloop.approaches import hidden_with_right_of_way
from harness.closedloop.routes import route_of
from harness.sensor.profiles import sensor_settings
from harness.truth.network.network import load_network
from tests.harness.closedloop.frames import frame_of

NETWORK = load_network("priority")
GRAPH = NETWORK.road.graph
SOUTH, WEST = (GRAPH.name.index(name) for name in ("south_in_0", "west_in_0"))
SENSOR = sensor_settings("lidar", {})
ROUTE = route_of(GRAPH, SOUTH, ["south_in", "north_out"])
EAST, NORTH = 0.0, 0.5 * np.pi


def traffic(ego_m=25.0, ego_mps=8.0, other_m=60.0, other_mps=15.0, route=("west_in", "east_out"), before=()):
    """The ego comes from the south, a car with right of way from the west; both so far from their stop lines."""
    south, west = GRAPH.line(SOUTH)[-1], GRAPH.line(WEST)[-1]
    frames = []
    for step in range(51):
        ago_s = 0.1 * (50 - step)
        lon = [south[0], west[0] - other_m - other_mps * ago_s, *(south[0] for _ in before)]
        lat = [south[1] - ego_m - ego_mps * ago_s, west[1], *(south[1] - away_m for away_m in before)]
        heading = [NORTH, EAST, *(NORTH for _ in before)]
        speed = [ego_mps, other_mps, *(0.0 for _ in before)]
        lanes = np.array([SOUTH, WEST, *(SOUTH for _ in before)]) + 1
        names = ["ego", "other", *(f"before{k}" for k in range(len(before)))]
        heading = np.array(heading)
        frames.append(frame_of(lon, lat, speed, step, names, heading_rad=heading, direction_rad=heading, lane=lanes))
    vehicle = SimpleNamespace(getRoute={"other": route}.get)
    return SimpleNamespace(
        frames=frames, network=NETWORK, running=SimpleNamespace(sumo=SimpleNamespace(vehicle=vehicle)), step_s=0.1
    )


def found(of):
    return hidden_with_right_of_way(of, 0, ROUTE, SENSOR)


def test_a_car_behind_the_building_that_was_never_in_sight_is_found():
    assert found(traffic()) == ("other", False)


@pytest.mark.parametrize(
    "changes",
    [
        {"other_m": 150.0},
        {"other_m": 5.0, "other_mps": 0.0},
        {"route": ("west_in", "south_out")},
        {"ego_m": 70.0},
        {"ego_m": 8.0, "ego_mps": 12.0},
        {"before": (10.0,)},
    ],
)
def test_one_that_comes_at_another_time_or_turns_off_or_an_ego_far_off_too_fast_or_behind_another_is_not(changes):
    assert found(traffic(**changes)) == ("", False)


def test_one_in_plain_view_is_not():
    assert found(traffic(ego_m=1.0, ego_mps=2.0, other_m=20.0, other_mps=8.0)) == ("", False)
