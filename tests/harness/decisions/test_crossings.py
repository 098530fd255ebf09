"""Where the ego's way meets ways that have right of way over it."""

from dataclasses import replace

import numpy as np
import pytest

from harness.decisions.crossings import LaneChain, crossings_of
from mmpf.map.control import FREE, NO_SIGNAL, YIELD, LinkControl
from tests.mmpf.map.scenes import graph_of

LINKS = [
    ("south", ":over"), (":over", "north"), ("west", ":on"), (":on", "east"), ("south", ":turn"), (":turn", "east"),
]  # fmt: skip
JUNCTION = (":over", ":on", ":turn")
LINES = {
    "south": [(0, -50), (0, -10)],
    ":over": [(0, -10), (0, 10)],
    "north": [(0, 10), (0, 100)],
    "west": [(-150, 0), (-10, 0)],
    ":on": [(-10, 0), (10, 0)],
    "east": [(10, 0), (150, 0)],
    ":turn": [(0, -10), (3, -3), (10, 0)],
}


def crossing_graph(yields=((0, 2), (4, 2))):
    """Return a way from south to north or east which a way from west to east crosses; ``yields`` has links and foes."""
    graph = graph_of(LINES, LINKS, in_junction=JUNCTION)
    # Links are in the order of the lanes that they lead from.
    order = [LINKS.index((graph.name[a], graph.name[b])) for a, b in zip(graph.link_from, graph.successor, strict=True)]
    place = {link: k for k, link in enumerate(order)}
    kind, foes = np.full(len(order), FREE), [[] for _ in order]
    for link, foe in yields:
        kind[place[link]], foes[place[link]] = YIELD, [place[foe]]
    control = LinkControl(
        kind=kind,
        signal=np.full(len(order), NO_SIGNAL),
        signal_name=(),
        foe=np.array([foe for each in foes for foe in each], dtype=np.int64),
        first_foe=np.cumsum([0, *map(len, foes)]),
    )
    return replace(graph, control=control)


GRAPH = crossing_graph()


def route(*names, graph=GRAPH):
    return LaneChain.of(graph, [graph.name.index(name) for name in names])


STRAIGHT_ON = route("south", ":over", "north")


def test_the_place_of_conflict_lies_where_the_middles_of_two_ways_are_near():
    (crossing,) = crossings_of(GRAPH, STRAIGHT_ON)
    (conflict,) = crossing.conflicts
    assert crossing.stop_m == pytest.approx(40.0)
    assert conflict.own_m == pytest.approx((48.0, 52.0))
    assert conflict.other_m == pytest.approx((148.0, 152.0))
    assert [GRAPH.name[lane] for lane in conflict.route.lanes] == ["west", ":on"]
    assert not conflict.merges


def test_ways_that_leave_by_the_same_lane_merge_and_meet_until_the_junction_ends():
    (crossing,) = crossings_of(GRAPH, route("south", ":turn", "east"))
    assert crossing.conflicts[0].merges
    assert crossing.conflicts[0].other_m[1] == pytest.approx(160.0)


def test_who_need_not_yield_or_does_not_come_to_the_junction_has_no_crossing():
    assert crossings_of(crossing_graph(yields=()), STRAIGHT_ON) == ()
    assert crossings_of(replace(GRAPH, control=None), STRAIGHT_ON) == ()
    assert crossings_of(GRAPH, route("west", ":on", "east")) == ()
    assert crossings_of(GRAPH, route("south")) == ()


def test_lanes_one_after_the_other_are_one_line():
    assert STRAIGHT_ON.begins_m == pytest.approx([0.0, 40.0, 60.0, 150.0])
    along, places = STRAIGHT_ON.sampled(38.0, 42.0)
    assert along == pytest.approx(np.linspace(38.0, 42.0, 9))
    assert places == pytest.approx(np.stack([np.zeros(9), np.linspace(-12.0, -8.0, 9)], axis=1))
