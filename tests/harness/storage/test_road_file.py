"""A road with a graph of lanes is read back from a run's folder as it was; a broken one is one clear line."""

import json
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.storage.road_file import read_road, write_road
from harness.truth.network.lanegraph import read_lane_graph
from mmpf.map.corridor_road import highway
from mmpf.map.graph_road import LaneGraphRoad

CROSSING = Path(__file__).parents[1] / "truth" / "network" / "nets" / "crossing.net.xml"


@pytest.fixture(scope="module")
def road():
    plane = read_lane_graph(CROSSING)
    return LaneGraphRoad(section_m=plane.extent_m, graph=plane.graph, walls_xy=np.array([[0.0, 0.1, 2.0, 3.5]]))


@pytest.fixture
def written(road, tmp_path):
    write_road(road, tmp_path / "road.json")
    return tmp_path / "road.json"


def test_a_graph_comes_back_as_it_was(road, written):
    back = read_road(written, "replay")
    for name, values in vars(back.graph).items():
        if isinstance(values, np.ndarray):
            assert np.array_equal(values, getattr(road.graph, name))
            assert values.dtype == getattr(road.graph, name).dtype
    assert back.graph.name == road.graph.name
    for name, values in vars(road.graph.control).items():
        assert np.array_equal(getattr(back.graph.control, name), values)
    assert back.section_m == road.section_m
    assert np.array_equal(back.walls_xy, road.walls_xy)


def test_a_road_without_a_graph_says_nothing_of_one(tmp_path):
    write_road(highway(), tmp_path / "road.json")
    assert set(json.loads((tmp_path / "road.json").read_text())) == {
        *("lanes", "reference_xy", "reference_start_m", "section_m")
    }


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("name", ["a", "a"]), ("name", 3), ("xy", [[0.0, 1.0]]), ("xy", [["a", "b"]]), ("xy", [[1e300, 0.0]] * 4),
        ("successor", [10**9]), ("successor", [0.5]), ("successor", [10**30]), ("first_point", [0, 1]),
        ("width_m", [0.0]), ("width_m", None), ("speed_limit_mps", "fast"), ("left", [-7]), ("in_junction", [10**6]),
    ],
)  # fmt: skip
def test_a_broken_graph_is_one_clear_line(written, column, value):
    fields = json.loads(written.read_text())
    fields["graph"][column] = value
    written.write_text(json.dumps(fields))
    with pytest.raises(InputError, match=r"`replay`: .*road\.json: broken, or no road"):
        read_road(written, "replay")


def test_lanes_that_would_fill_the_memory_are_refused(written):
    fields = json.loads(written.read_text())
    fields["graph"]["xy"] = (np.array(fields["graph"]["xy"]) * 1e5).tolist()
    written.write_text(json.dumps(fields))
    with pytest.raises(InputError, match="too many, too long or too wide"):
        read_road(written, "replay")
