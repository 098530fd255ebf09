from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mmpf.map.lane_graph import BESIDE_M, NOWHERE, LaneGraph
from mmpf.numerics.arrays import FloatArray
from tests.mmpf.map.scenes import arc, graph_of


def crooked_lines(seed: int, lanes: int = 25) -> LaneGraph:
    rng = np.random.default_rng(seed)
    lines = {}
    for k in range(lanes):
        heading = rng.uniform(-np.pi, np.pi) + np.cumsum(rng.normal(0.0, 0.25, 12))
        steps = rng.uniform(1.0, 12.0, 12)[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
        lines[str(k)] = rng.uniform(-80.0, 80.0, 2) + np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return graph_of(lines)


def distances(graph: LaneGraph, x: float, y: float) -> FloatArray:
    """Distance to each lane's middle line, piece by piece."""
    result = np.full(len(graph), np.inf)
    for lane in range(len(graph)):
        points = graph.xy[graph.first_point[lane] : graph.first_point[lane + 1]]
        for a, b in pairwise(points):
            t = np.clip(np.dot([x, y] - a, b - a) / np.dot(b - a, b - a), 0.0, 1.0)
            result[lane] = min(result[lane], np.hypot(*(a + t * (b - a) - [x, y])))
    return result


@pytest.mark.slow
def test_the_lanes_beside_places_are_those_that_a_search_of_all_lanes_finds() -> None:
    graph, rng = crooked_lines(0), np.random.default_rng(1)
    x, y = rng.uniform(-140.0, 140.0, (2, 300))
    near = graph.lanes_near(x, y, most=8)
    for n in range(len(x)):
        away = distances(graph, x[n], y[n])
        expected = np.flatnonzero(away <= 1.6 + BESIDE_M)
        expected = expected[np.argsort(away[expected])]
        found = near.lane[n][near.lane[n] >= 0]
        assert len(found) == len(expected) <= 8
        assert np.abs(near.left_m[n, : len(found)]) == pytest.approx(away[expected], abs=1e-9)
        assert set(found.tolist()) == set(expected.tolist())


def test_a_place_on_a_lane_and_back_is_the_same_place() -> None:
    graph, rng = crooked_lines(2), np.random.default_rng(3)
    lane = rng.integers(0, len(graph), 3000)
    along = rng.uniform(-0.1, 1.1, 3000) * graph.length_m[lane]
    x, y, heading = graph.place(lane, along, np.zeros(3000))
    back, left, direction = graph.on_lane(lane, x, y)
    # Where a crooked line comes near itself, or turns, another piece may be as near.
    assert np.mean(np.abs(back - along) < 1e-9) > 0.97
    assert left == pytest.approx(np.zeros(3000), abs=1e-9)
    assert np.mean(np.abs(np.sin(direction - heading)) < 1e-9) > 0.97


def test_offsets_are_to_the_left_and_directions_follow_the_bend() -> None:
    graph = graph_of({"bend": arc(50.0, np.pi / 2, 400)})
    quarter = np.array([25.0 * np.pi])
    inside = 48.0 * np.sqrt(0.5)
    along, left, heading = graph.on_lane(np.array([0]), np.array([inside]), np.array([50.0 - inside]))
    assert along == pytest.approx(0.5 * quarter, abs=0.05)
    assert left == pytest.approx([2.0], abs=1e-2)
    assert heading == pytest.approx([np.pi / 4], abs=0.01)
    assert graph.length_m == pytest.approx(quarter, rel=1e-4)


def test_a_vehicle_is_on_the_lane_that_leads_its_way() -> None:
    graph = graph_of({"there": [(0, 0), (100, 0)], "back": [(100, 3), (0, 3)], "across": [(50, -20), (50, 20)]})
    x, y = np.array([20.0, 20.0, 50.0, 20.0]), np.array([1.8, 1.8, 0.4, 30.0])
    heading = np.array([0.05, np.pi - 0.05, np.pi / 2, 0.0])
    assert graph.lane_at(x, y, heading).tolist() == [0, 1, 2, NOWHERE]


def test_off_every_lane_there_is_no_place() -> None:
    graph = graph_of({"there": [(0, 0), (100, 0)]})
    assert np.isnan(graph.on_lane(np.array([NOWHERE]), np.zeros(1), np.zeros(1))).all()
    assert np.isnan(graph.place(np.array([NOWHERE]), np.zeros(1), np.zeros(1))).all()


@pytest.mark.parametrize(
    "broken",
    [
        {"name": ("a", "a")},
        {"width_m": np.array([3.0, 0.0])},
        {"left": np.array([5, -1])},
        {"xy": np.array([[0.0, 0.0], [0.0, 0.0], [0.0, 4.0], [9.0, 4.0]])},
        {"first_point": np.array([0, 1, 4])},
        {"xy": np.array([[0.0, np.nan], [9.0, 0.0], [0.0, 4.0], [9.0, 4.0]])},
    ],
)
def test_a_graph_that_nobody_can_drive_on_is_refused(broken: dict[str, object]) -> None:
    graph = graph_of({"a": [(0, 0), (9, 0)], "b": [(0, 4), (9, 4)]})
    with pytest.raises(ValueError, match="lane"):
        replace(graph, **broken)  # type: ignore[arg-type]
