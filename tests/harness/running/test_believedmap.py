"""What trackers are told of the road, apart from the road that there is."""

from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.running.believedmap import believed_map
from harness.running.resolve import resolve_run_config
from harness.truth.network.lanegraph import read_lane_graph
from mmpf.map.corridor_road import CorridorRoad, highway
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import NOWHERE
from mmpf.map.road import Lane

CROSSING = Path(__file__).parents[1] / "truth" / "network" / "nets" / "crossing.net.xml"


def told(road, what):
    """Return the road as a tracker is told it under this setting of its beliefs."""
    return believed_map(road, resolve_run_config(settings=[f"tracker.believes.map={what}"]).tracker.believes.map)


@pytest.fixture(scope="module")
def crossing():
    plane = read_lane_graph(CROSSING)
    return LaneGraphRoad(section_m=plane.extent_m, graph=plane.graph, walls_xy=np.array([[0.0, 0.1, 2.0, 3.5]]))


@pytest.mark.parametrize("kind", ["main road", "crossing"])
def test_without_a_map_there_is_no_lane_anywhere_and_no_wall(kind, crossing):
    blind = told(highway() if kind == "main road" else crossing, "none")
    place = np.linspace(-300.0, 900.0, 50)
    assert (blind.graph.lane_at(place, np.zeros(50), np.zeros(50)) == NOWHERE).all()
    assert not blind.lanes
    assert blind.walls_xy is None


def test_one_lane_is_as_wide_as_all():
    (lane,) = told(highway(lanes=5, lane_width_m=3.6), "one-lane").lanes
    assert (lane.right_m, lane.left_m) == (0.0, 18.0)


def test_an_auxiliary_lane_is_no_part_of_the_one_lane():
    lanes = (Lane(1, 4.0, 8.0, -450.0, 1000.0), Lane(2, 0.0, 4.0, -450.0, 1000.0), Lane(3, -4.0, 0.0, 188.0, 411.0))
    (lane,) = told(CorridorRoad(lanes), "one-lane").lanes
    assert lane == Lane(1, 0.0, 8.0, -450.0, 1000.0)


def test_what_no_map_can_be_is_one_clear_line():
    with pytest.raises(InputError, match=r"tracker\.believes\.map") as error:
        told(highway(), "two")
    assert "\n" not in str(error.value)


def test_on_a_graph_one_lane_is_refused(crossing):
    with pytest.raises(InputError, match="networks with a main road"):
        told(crossing, "one-lane")
