"""The way of an ego over a graph of lanes, up to the first signal."""

from dataclasses import replace

import numpy as np
import pytest

from harness.closedloop.beliefs import ego_of, true_bodies
from harness.closedloop.routes import way_of
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


def names(graph, way):
    return [graph.name[lane] for lane in way.lanes]


def test_the_way_goes_where_the_route_does():
    assert names(GRAPH, way_of(GRAPH, 0, ["in", "on", "last"])) == ["in_0", ":j_0", "on_0", "last_0"]
    assert names(GRAPH, way_of(GRAPH, 0, ["in", "up"])) == ["in_0", ":j_1", "up_0"]


def test_it_ends_before_a_signal_and_where_no_lane_leads_on():
    graph = held_at(0)
    assert names(graph, way_of(graph, 0, ["in", "on", "last"])) == ["in_0"]
    assert names(GRAPH, way_of(GRAPH, 0, ["in", "elsewhere"])) == ["in_0"]


def test_what_is_left_of_it_is_counted_along_its_lanes():
    way = way_of(GRAPH, 0, ["in", "on", "last"])
    assert way.left_m(GRAPH, 0, 20.0, 0.0) == pytest.approx(180.0)
    assert way.left_m(GRAPH, 3, 100.0, 0.3) == pytest.approx(100.0)
    assert way.left_m(GRAPH, 4, 60.0, 50.0) == 0.0


def test_a_driver_minds_who_is_on_the_way_that_its_route_takes():
    both = frame_of([20.0, 100.0, 60.0], [0.0, 0.0, 60.0], direction_rad=[0.0, 0.0, 0.5 * np.pi])
    road = LaneGraphRoad(graph=GRAPH)
    for edges, leader in ((["in", "on"], 0), (["in", "up"], 1)):
        ego = ego_of(both, way_of(GRAPH, 0, edges).lanes)
        assert believe(true_bodies(both), ego, road).leader.body[0] == leader
