"""The route of an ego over a graph of lanes, up to the first signal."""

from dataclasses import replace

import numpy as np
import pytest

from harness.closedloop.beliefs import ego_of, true_bodies
from harness.closedloop.routes import MainRoadRoute, route_of
from harness.decisions.belief import believe
from mmpf.map.control import FREE, NO_SIGNAL, SIGNAL, LinkControl
from mmpf.map.graph_road import LaneGraphRoad
from tests.harness.closedloop.frames import frame_of
from tests.mmpf.map.scenes import graph_of

GRAPH = graph_of(
    {
        "in_0": [(0, 0), (50, 0)],
        ":j_0": [(50, 0), (60, 0)],
        ":j_1": [(50, 0), (60, 10)],
        "on_0": [(60, 0), (160, 0)],
        "up_0": [(60, 10), (60, 200)],
        "last_0": [(160, 0), (200, 0)],
    },
    [("in_0", ":j_0"), ("in_0", ":j_1"), (":j_0", "on_0"), (":j_1", "up_0"), ("on_0", "last_0")],
    in_junction=(":j_0", ":j_1"),
)


def held_at(link):
    kind = np.full(len(GRAPH.successor), FREE)
    kind[link] = SIGNAL
    signal = np.where(kind == SIGNAL, 0, NO_SIGNAL)
    none = np.array([], dtype=np.int64)
    first = np.zeros(len(kind) + 1, dtype=np.int64)
    return replace(GRAPH, control=LinkControl(kind, signal, ("s",), none, first))


def names(graph, route):
    return [graph.name[lane] for lane in route.lanes]


def test_the_way_goes_where_the_route_does_to_a_signal_or_where_no_lane_leads_on():
    assert names(GRAPH, route_of(GRAPH, 0, ["in", "on", "last"])) == ["in_0", ":j_0", "on_0", "last_0"]
    assert names(GRAPH, route_of(GRAPH, 0, ["in", "up"])) == ["in_0", ":j_1", "up_0"]
    graph = held_at(0)
    assert names(graph, route_of(graph, 0, ["in", "on", "last"])) == ["in_0"]
    assert names(GRAPH, route_of(GRAPH, 0, ["in", "elsewhere"])) == ["in_0"]


def test_what_is_left_of_it_is_counted_along_its_lanes():
    route = route_of(GRAPH, 0, ["in", "on", "last"])
    frame = frame_of([20.0, 100.0, 60.0, 198.0, 195.0], [0.0, 0.3, 50.0, 0.0, 0.0], lane=np.array([1, 4, 5, 6, 6]))
    assert [route.left_m(frame, row) for row in range(5)] == pytest.approx([180.0, 100.0, 0.0, 2.0, 5.0])
    # The ego of 4.5 m is at the end where its front is less than a metre before it.
    assert [route.is_at_end(replace(frame, ego=row)) for row in (0, 3, 4)] == [False, True, False]


def test_a_main_road_ends_thirty_metres_beyond_its_section_and_has_no_place_to_yield():
    route, frame = MainRoadRoute(600.0), frame_of([630.1, 630.0], [0.0, 0.0])
    assert [route.is_at_end(replace(frame, ego=row)) for row in (0, 1)] == [True, False]
    assert route.passage(0.1, None) is None


def test_a_driver_minds_who_is_on_the_way_that_its_route_takes():
    both = frame_of([20.0, 100.0, 60.0], [0.0, 0.0, 60.0], direction_rad=[0.0, 0.0, 0.5 * np.pi])
    road = LaneGraphRoad(graph=GRAPH)
    for edges, leader in ((["in", "on"], 0), (["in", "up"], 1)):
        ego = ego_of(both, route_of(GRAPH, 0, edges).lanes)
        assert believe(true_bodies(both), ego, road).leader.body[0] == leader
