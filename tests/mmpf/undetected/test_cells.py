"""Lanes in pieces, and where traffic flows from piece to piece."""

from dataclasses import replace

import numpy as np
import pytest

from mmpf.map.control import FREE, NO_SIGNAL, YIELD, LinkControl
from mmpf.map.corridor_road import CorridorRoad, highway
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map
from mmpf.map.road import Lane
from mmpf.undetected.apart import std_along_m
from mmpf.undetected.cells import BEYOND_SECTION_M, CELL_M, cells_of
from tests.mmpf.map.scenes import arc, graph_of
from tests.mmpf.scenes import tracks_of

BEND = arc(30.0, np.pi / 2)
LEFT_OUT = BEND[-1] + [0.0, 40.0]
FORK = graph_of(
    {
        "in": [(-60.0, 0.0), (0.0, 0.0)],
        "ahead": [(0.0, 0.0), (20.0, 0.0)],
        "left": BEND,
        "out": [(20.0, 0.0), (83.0, 0.0)],
        "left out": [BEND[-1], LEFT_OUT],
        "alone": [(0.0, -50.0), (3.0, -50.0)],
    },
    links=[("in", "ahead"), ("in", "left"), ("ahead", "out"), ("left", "left out")],
    in_junction=("ahead", "left"),
)


@pytest.fixture(scope="module", params=["highway", "fork"])
def road(request):
    return highway() if request.param == "highway" else LaneGraphRoad(graph=FORK)


def test_the_cells_of_a_lane_are_as_long_as_the_lane(road):
    cells, _ = cells_of(road)
    total = np.bincount(cells.lane, cells.length_m)[1:]
    start, end = road.section_m
    whole = [end - start + 2 * BEYOND_SECTION_M] * 5 if road.lanes else road.graph.length_m
    np.testing.assert_allclose(total, whole)
    assert cells.length_m.max() <= CELL_M + 1e-9


def test_what_flows_out_of_a_cell_flows_into_others_or_leaves_the_road(road):
    cells, links = cells_of(road)
    out = np.bincount(links.source, links.share, minlength=len(cells))
    assert np.all(np.isclose(out, 1.0) | (out == 0.0))
    reached = np.isin(np.arange(len(cells)), links.target)
    np.testing.assert_array_equal(cells.entry, ~reached)


def test_deviations_along_a_lane_are_those_of_the_axis_that_it_follows():
    cells, _ = cells_of(LaneGraphRoad(graph=graph_of({"east": [(0, 0), (4, 0)], "north": [(0, 0), (0, 4)]})))
    along = std_along_m(cells, tracks_of([0.0], [0.0], std_lon_m=8.0, std_lat_m=0.5))
    np.testing.assert_allclose(along[:, 0], np.where(np.abs(cells.heading_rad) < 0.1, 8.0, 0.5))


def test_linked_cells_touch(road):
    cells, links = cells_of(road)
    source, target = links.source, links.target
    ends = [
        np.stack([cells.lon_m + side * np.cos(cells.heading_rad), cells.lat_m + side * np.sin(cells.heading_rad)])
        for side in (0.5 * cells.length_m, -0.5 * cells.length_m)
    ]
    assert np.hypot(*(ends[0][:, source] - ends[1][:, target])).max() < 1.0


def test_ways_across_a_junction_share_the_traffic_of_the_lane_before_them():
    cells, _ = cells_of(LaneGraphRoad(graph=FORK))
    shares = {FORK.name[lane - 1]: share for lane, share in zip(cells.lane, cells.share, strict=True)}
    assert shares == {"in": 1.0, "ahead": 0.5, "left": 0.5, "out": 1.0, "left out": 1.0, "alone": 1.0}


def test_a_path_across_a_junction_that_the_map_cuts_has_the_usual_traffic():
    cut = graph_of(
        {"path": [(0.0, 0.0), (20.0, 0.0)], "out": [(20.0, 0.0), (60.0, 0.0)]}, [("path", "out")], [], ("path",)
    )
    cells, _ = cells_of(LaneGraphRoad(graph=cut))
    assert (cells.share == 1.0).all()
    assert cells.entry.tolist() == [True, *[False] * (len(cells) - 1)]


def test_traffic_from_beyond_the_map_begins_where_no_lane_leads():
    cells, _ = cells_of(LaneGraphRoad(graph=FORK))
    assert [FORK.name[lane - 1] for lane in cells.lane[cells.entry]] == ["in", "alone"]


def test_a_lane_with_a_beginning_and_an_end_is_no_longer_than_that():
    cells, _ = cells_of(CorridorRoad(lanes=(Lane(1, 0.0, 3.5, 100.0, 130.0),)))
    assert cells.length_m.sum() == pytest.approx(30.0)
    assert cells.lon_m.min() > 100.0
    assert np.bincount(cells.stretch).tolist() == [5, 1]


def test_without_a_map_there_are_no_cells():
    cells, links = cells_of(LaneGraphRoad(graph=without_map()))
    assert len(cells) == len(links.source) == 0


@pytest.mark.parametrize(
    ("ends_m", "in_junction", "queues_to_m"), [((60.0, 90.0, 120.0), (), 90.0), ((30.0, 50.0, 80.0), ("second",), 30.0)]
)
def test_each_cell_knows_how_far_it_is_to_the_next_stop_line_but_within_a_junction(ends_m, in_junction, queues_to_m):
    names = ("first", "second", "third")
    starts_m = dict(zip(names, (0.0, *ends_m), strict=False))
    lines = {name: [(starts_m[name], 0.0), (end, 0.0)] for name, end in zip(names, ends_m, strict=True)}
    graph = graph_of(lines, links=[("first", "second"), ("second", "third")], in_junction=in_junction)
    nobody = np.zeros(0, dtype=np.int64)
    control = LinkControl(np.array([FREE, YIELD]), np.full(2, NO_SIGNAL), (), nobody, np.zeros(3, dtype=np.int64))
    cells, _ = cells_of(LaneGraphRoad(graph=replace(graph, control=control)))
    before = cells.lon_m < queues_to_m
    np.testing.assert_allclose(cells.before_stop_m[before], ends_m[1] - cells.lon_m[before])
    assert np.isinf(cells.before_stop_m[~before]).all()


def test_on_a_road_in_strips_no_stop_line_is_known():
    cells, _ = cells_of(highway())
    assert np.isinf(cells.before_stop_m).all()
