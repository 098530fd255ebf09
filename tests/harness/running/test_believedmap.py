"""What trackers are told of the road, apart from the road that there is."""

from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.running.open import believed_map
from harness.running.resolve import resolve_run_config
from harness.truth.network.lanegraph import read_lane_graph
from mmpf.map.corridor_road import CorridorRoad, highway
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import NOWHERE
from mmpf.map.road import Lane

CROSSING = Path(__file__).parents[1] / "truth" / "network" / "nets" / "crossing.net.xml"


def told(road, *settings):
    """Return the road as a tracker is told it under these settings of its beliefs."""
    config = resolve_run_config(settings=[f"tracker.believes.{setting}" for setting in settings])
    assert config.tracker.believes.of_the_map == bool(settings)
    return believed_map(road, config.tracker.believes)


@pytest.fixture(scope="module")
def crossing():
    plane = read_lane_graph(CROSSING)
    return LaneGraphRoad(section_m=plane.extent_m, graph=plane.graph, walls_xy=np.array([[0.0, 0.1, 2.0, 3.5]]))


@pytest.mark.parametrize("kind", ["main road", "crossing"])
def test_without_a_map_there_is_no_lane_anywhere_and_no_wall(kind, crossing):
    blind = told(highway() if kind == "main road" else crossing, "map=none")
    place = np.linspace(-300.0, 900.0, 50)
    assert (blind.graph.lane_at(place, np.zeros(50), np.zeros(50)) == NOWHERE).all()
    assert not blind.lanes
    assert blind.walls_xy is None


def test_an_auxiliary_lane_is_no_part_of_the_one_lane():
    lanes = (Lane(1, 4.0, 8.0, -450.0, 1000.0), Lane(2, 0.0, 4.0, -450.0, 1000.0), Lane(3, -4.0, 0.0, 188.0, 411.0))
    (lane,) = told(CorridorRoad(lanes), "map=one-lane").lanes
    assert lane == Lane(1, 0.0, 8.0, -450.0, 1000.0)


def test_lanes_are_left_out_by_their_numbers_and_shifted_to_the_left():
    road = told(highway(), "lanes_left_out=[2,4]", "map_shift_m=0.5")
    assert sorted(lane.number for lane in road.lanes) == [1, 3, 5]
    rightmost = next(lane for lane in road.lanes if lane.number == 5)
    assert (rightmost.right_m, rightmost.left_m) == (0.5, 4.16)


def test_a_graph_is_shifted_to_the_north(crossing):
    shifted = told(crossing, "map_shift_m=-1.5").graph
    assert np.allclose(shifted.xy - crossing.graph.xy, [0.0, -1.5])
    assert shifted.name == crossing.graph.name


@pytest.mark.parametrize(
    ("settings", "problem"),
    [
        (("lanes_left_out=[9]",), "the road has lanes 1, 2, 3, 4, 5"),
        (("map=two",), "map"),
        (("map_shift_m=1e9",), "map_shift_m"),
    ],
)
def test_what_no_map_can_be_is_one_clear_line(settings, problem):
    with pytest.raises(InputError, match=problem):
        told(highway(), *settings)


def test_on_a_graph_lanes_of_a_main_road_are_refused(crossing):
    for setting in ("map=one-lane", "lanes_left_out=[1]"):
        with pytest.raises(InputError, match="networks with a main road"):
            told(crossing, setting)


@pytest.mark.parametrize("idle", ["map_shift_m=0.5", "lanes_left_out=[2]"])
def test_no_map_that_is_shifted_or_lacks_lanes_is_refused_in_one_line(idle):
    name = idle.partition("=")[0]
    with pytest.raises(InputError, match=f"^tracker.believes: map none leaves no lanes .* leave out map or {name}$"):
        told(highway(), "map=none", idle)
    assert told(highway(), "map=none", "map_shift_m=0").graph is not None
