from dataclasses import replace

import numpy as np
import pytest

from mmpf.map.control import FREE, NO_SIGNAL, SIGNAL, YIELD, LinkControl
from mmpf.map.lane_graph import LaneGraph
from mmpf.numerics.arrays import FloatArray
from mmpf.surroundings.right_of_way import OnLanes, SignalEstimator
from tests.mmpf.map.scenes import graph_of

LENGTH_M = 4.0


def crossing(kinds: dict[str, int]) -> LaneGraph:
    """Two roads that cross, one to the east and one to the north; each entry is a link of the kind that is given."""
    lines = {
        "east-in": [(-100, 0), (-10, 0)],
        "east-path": [(-10, 0), (10, 0)],
        "east-out": [(10, 0), (100, 0)],
        "north-in": [(0, -100), (0, -10)],
        "north-path": [(0, -10), (0, 10)],
        "north-out": [(0, 10), (0, 100)],
    }
    links = [
        (f"{road}-{part}", f"{road}-{then}")
        for road in ("east", "north")
        for part, then in (("in", "path"), ("path", "out"))
    ]
    graph = graph_of(lines, links, in_junction=("east-path", "north-path"))  # type: ignore[arg-type]
    kind = np.array([kinds["east"], FREE, kinds["north"], FREE])
    signal = np.where(kind == SIGNAL, np.array([0, NO_SIGNAL, 1, NO_SIGNAL]), NO_SIGNAL)
    # Whoever comes from the south lets those from the west go first.
    control = LinkControl(kind, signal, ("west", "south"), foe=np.array([0]), first_foe=np.array([0, 0, 0, 1, 1]))
    return replace(graph, control=control)


def vehicles(graph: LaneGraph, *them: tuple[str, float, float]) -> OnLanes:
    """Vehicles (lane, arc length, speed), all seen."""
    return OnLanes(
        lane=np.array([graph.name.index(lane) for lane, *_ in them], dtype=np.int64),
        along_m=np.array([along for _, along, _ in them], dtype=float),
        speed_mps=np.array([speed for *_, speed in them], dtype=float),
        length_m=np.full(len(them), LENGTH_M),
        seen=np.ones(len(them), dtype=bool),
    )


def after_watching(graph: LaneGraph, seconds: float, *them: tuple[str, float, float]) -> FloatArray:
    signals = SignalEstimator(graph)
    for _ in range(round(10 * seconds)):
        signals.look(vehicles(graph, *them), None, 0.1)
    chance = signals.look(vehicles(graph), None, 0.0)
    assert chance is not None
    return chance


SIGNALS = {"east": SIGNAL, "north": SIGNAL}


def test_of_a_signal_that_nobody_told_and_nobody_drives_by_nothing_is_known() -> None:
    assert after_watching(crossing(SIGNALS), 3.0) == pytest.approx([0.5, 1.0, 0.5, 1.0])


def test_who_drives_past_a_signal_shows_that_it_is_open_and_that_of_the_crossing_road_closed() -> None:
    chance = after_watching(crossing(SIGNALS), 0.5, ("east-path", 5.0, 10.0))
    assert chance[0] > 0.95
    assert chance[2] < 0.05


def test_two_ways_that_each_list_the_other_as_crossing_count_once() -> None:
    graph = crossing(SIGNALS)
    assert graph.control is not None
    both = replace(graph.control, foe=np.array([2, 0]), first_foe=np.array([0, 1, 1, 2, 2]))
    once, twice = SignalEstimator(graph), SignalEstimator(replace(graph, control=both))
    for each in (once, twice):
        each.look(vehicles(graph, ("east-path", 5.0, 10.0)), None, 0.1)
    np.testing.assert_array_equal(once.log_odds, twice.log_odds)
    assert once.log_odds.any()


def test_who_waits_at_the_line_shows_that_the_signal_is_closed_and_nothing_of_others() -> None:
    chance = after_watching(crossing(SIGNALS), 2.0, ("north-in", 87.0, 0.0))
    assert chance[2] < 0.1
    assert chance[0] == pytest.approx(0.5)


def test_who_stands_far_from_the_line_shows_nothing() -> None:
    assert after_watching(crossing(SIGNALS), 2.0, ("north-in", 40.0, 0.0))[2] == pytest.approx(0.5)


def test_what_was_seen_of_a_signal_is_forgotten() -> None:
    graph = crossing(SIGNALS)
    signals = SignalEstimator(graph)
    signals.log_odds = np.array([4.0, 0.0, -4.0, 0.0])
    for _ in range(600):
        signals.look(vehicles(graph), None, 0.1)
    assert np.abs(signals.log_odds).max() < 0.1


def test_a_signal_that_the_scan_tells_is_as_it_is_told_whatever_was_seen_but_for_those_who_start_late() -> None:
    graph = crossing(SIGNALS)
    signals = SignalEstimator(graph)
    signals.log_odds = np.array([4.0, 0.0, -4.0, 0.0])
    chance = signals.look(vehicles(graph), np.array([False, True]), 0.0)
    assert chance is not None
    assert chance.tolist() == [0.1, 1.0, 0.95, 1.0]


@pytest.mark.parametrize(
    ("comes", "may_go"),
    [
        (("east-in", 65.0, 10.0), False),
        (("east-in", 20.0, 10.0), True),
        (("east-path", 5.0, 10.0), False),
        (("east-path", 19.0, 10.0), True),
        (("east-out", 5.0, 10.0), True),
    ],
)
def test_who_has_to_give_way_goes_unless_one_with_right_of_way_comes(
    comes: tuple[str, float, float], may_go: bool
) -> None:
    graph = crossing({"east": FREE, "north": YIELD})
    chance = SignalEstimator(graph).look(vehicles(graph, comes), None, 0.0)
    assert chance is not None
    assert chance[2] == (0.95 if may_go else 0.3)
    assert chance[0] == 1.0, "who has right of way waits for nobody"


def test_a_graph_that_says_nothing_of_its_links_leaves_everybody_go() -> None:
    graph = replace(crossing(SIGNALS), control=None)
    assert SignalEstimator(graph).look(vehicles(graph), None, 0.0) is None


def test_links_that_lead_nowhere_are_refused() -> None:
    control = crossing(SIGNALS).control
    with pytest.raises(ValueError, match="kind, foe or signal"):
        replace(control, foe=np.array([9]))
    with pytest.raises(ValueError, match="must be of the kind SIGNAL"):
        replace(control, signal=np.array([0, 1, 1, NO_SIGNAL]))
