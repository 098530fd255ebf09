"""Lanelets as a lane graph in the plane, for recordings of junctions, bends and two-way roads."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from shapely.ops import substring

from harness.common.errors import InputError
from harness.truth.network.lanegraph import DECIMALS, LONGEST_PIECE_M, NEAR_BOTH_ENDS, SAME_POINT_M, SHORTEST_LANE_M
from harness.truth.network.polyline import beside, followers, grid_origin, length_of
from harness.truth.recorded.lanelets import Lanelet, road_from_lanelets
from mmpf.map.control import FREE, NO_SIGNAL, SIGNAL, YIELD, LinkControl
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import NO_LIMIT_MPS, NOWHERE, LaneGraph
from mmpf.map.limits import graph_problem
from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, wrapped

# On one road lanelets lead one way to within this angle, but for a small share of their length, as of a drawn hook.
ONE_WAY_RAD, MOST_ASIDE = np.deg2rad(20.0), 0.05
# Pieces of this length tell where a lanelet leads.
PIECE_M = 20.0
# Kinds of lanelets that no car drives on.
NOT_FOR_CARS = frozenset({"crosswalk", "sidewalk", "bicycleLane"})
NARROWEST_LANE_M, STRAIGHT_WITHIN_M = 0.5, 0.05
# Lanes that meet at their ends do not cross there.
ENDS_M = 1.0


def road_of_lanelets(
    lanelets: Sequence[Lanelet], x: FloatArray, y: FloatArray, path: Path
) -> tuple[Road, tuple[float, float]]:
    """Return the road of lanelets: a frame along them where they all lead one way, else the plane.

    Args:
        lanelets: The lanelets.
        x: Positions of the traffic, shape (n,).
        y: Likewise.
        path: The file, for messages.

    Returns:
        The road, and the file's coordinates of the origin of its plane.

    Raises:
        InputError: See ``plane_of_lanelets``.
    """
    if are_one_road(lanelets):
        return road_from_lanelets(lanelets, x, y), (0.0, 0.0)
    return plane_of_lanelets(lanelets, path)


def are_one_road(lanelets: Sequence[Lanelet]) -> bool:
    """Return whether lanelets all lead one way and nearly straight, so that one road frame suits them."""
    chords = np.concatenate([_chords(lanelet.centre_xy()) for lanelet in lanelets])
    mean = np.arctan2(*chords.sum(axis=0)[::-1])
    aside = np.abs(wrapped(np.arctan2(chords[:, 1], chords[:, 0]) - mean)) > ONE_WAY_RAD
    length = np.hypot(chords[:, 0], chords[:, 1])
    return bool(length[aside].sum() <= MOST_ASIDE * length.sum())


def plane_of_lanelets(lanelets: Sequence[Lanelet], path: Path) -> tuple[LaneGraphRoad, tuple[float, float]]:
    """Return the road of lanelets as lanes in the plane, and the file's coordinates of its origin.

    Raises:
        InputError: None of them is for cars, or they are larger than can be driven on.
    """
    by_name, lines = _for_cars(lanelets, path)
    origin = grid_origin(np.min([line.min(axis=0) for line in lines.values()], axis=0))
    graph = _graph(by_name, {name: line - origin for name, line in lines.items()}, path)
    return road_of_graph(graph), (float(origin[0]), float(origin[1]))


def graph_of_lanelets(lanelets: Sequence[Lanelet], path: Path) -> LaneGraph:
    """Return lanelets as lanes in their own plane; see ``plane_of_lanelets``."""
    return _graph(*_for_cars(lanelets, path), path)


def road_of_graph(graph: LaneGraph) -> LaneGraphRoad:
    """Return the road whose frame is the plane of a graph."""
    start, end = float(graph.xy[:, 0].min()), float(graph.xy[:, 0].max())
    return LaneGraphRoad(graph, (start, max(end, start + 1.0)))


def _for_cars(lanelets: Sequence[Lanelet], path: Path) -> tuple[dict[str, Lanelet], dict[str, FloatArray]]:
    """Return the lanelets for cars, and the middle lines of those that are long enough to be lanes."""
    by_name = {lanelet.name: lanelet for lanelet in lanelets if NOT_FOR_CARS.isdisjoint(lanelet.kinds)}
    lines = {name: _middle(lanelet) for name, lanelet in by_name.items()}
    lines = {name: line for name, line in lines.items() if length_of(line) >= SHORTEST_LANE_M}
    if not lines:
        raise InputError(f"{path}: no lanelet of it is for cars; give a scenario with roads")
    return by_name, lines


def _graph(by_name: Mapping[str, Lanelet], lines: Mapping[str, FloatArray], path: Path) -> LaneGraph:
    graph = _assemble(by_name, {name: np.round(line, DECIMALS) for name, line in lines.items()})
    problem = graph_problem(graph)
    if problem:
        raise InputError(f"{path}: {problem}; cut out the part that is driven on")
    return graph


def _assemble(by_name: Mapping[str, Lanelet], lines: Mapping[str, FloatArray]) -> LaneGraph:
    names = tuple(lines)
    index = {name: k for k, name in enumerate(names)}
    chosen = [by_name[name] for name in names]
    follow = [
        followers(name, index, lambda other: [each for each in by_name[other].successors if each in by_name])
        for name in names
    ]
    crossed = _crossings(list(lines.values()))
    graph = LaneGraph(
        name=names,
        xy=np.concatenate(list(lines.values())),
        first_point=np.cumsum([0, *map(len, lines.values())]),
        width_m=np.array([_width(lanelet) for lanelet in chosen]),
        speed_limit_mps=np.array([lanelet.speed_limit_mps or NO_LIMIT_MPS for lanelet in chosen]),
        left=_beside(chosen, [lanelet.left for lanelet in chosen], index),
        right=_beside(chosen, [lanelet.right for lanelet in chosen], index),
        successor=np.array([to for each in follow for to in each], dtype=np.int64),
        first_successor=np.cumsum([0, *map(len, follow)]),
        in_junction=_in_junction(chosen, crossed, follow),
    )
    return replace(graph, control=_control(chosen, graph, crossed))


def _beside(chosen: Sequence[Lanelet], neighbours: Sequence[str | None], index: Mapping[str, int]) -> IntArray:
    """Return the lane beside each, (l,): the neighbour that the file names, unless one of the two parts from there."""
    found = np.full(len(chosen), NOWHERE)
    for k, (lanelet, name) in enumerate(zip(chosen, neighbours, strict=True)):
        if name is None or name not in index or index[name] == k:
            continue
        other = chosen[index[name]]
        apart = 0.5 * (_width(lanelet) + _width(other))
        away, _ = beside(lanelet.centre_xy(), other.centre_xy(), NEAR_BOTH_ENDS)
        if 0.6 * apart <= away.min() and away.max() <= apart + 2.0:
            found[k] = index[name]
    return found


def _crossings(lines: Sequence[FloatArray]) -> list[set[int]]:
    """Return for each lane the others that cross it, ends left out."""
    inner = [substring(shapely.LineString(line), min(ENDS_M, 0.4 * length_of(line)), -ENDS_M) for line in lines]
    one, other = shapely.STRtree(inner).query(inner, predicate="intersects")
    found: list[set[int]] = [set() for _ in lines]
    for a, b in zip(one.tolist(), other.tolist(), strict=True):
        if a != b:
            found[a].add(b)
    return found


def _in_junction(chosen: Sequence[Lanelet], crossed: Sequence[set[int]], follow: Sequence[Sequence[int]]) -> BoolArray:
    """Return which lanes lead across a junction, (l,): as the file says, else those that meet or cross others."""
    told = np.array([lanelet.in_junction is not None for lanelet in chosen])
    said = np.array([bool(lanelet.in_junction) for lanelet in chosen])
    crossing = np.array([bool(others) for others in crossed])
    inside = crossing.copy()
    before: dict[int, list[int]] = {}
    for k, after in enumerate(follow):
        if crossing[list(after)].any():
            inside[list(after)] = True
        for to in after:
            before.setdefault(to, []).append(k)
    for lanes in before.values():
        if len(lanes) > 1 and crossing[lanes].any():
            inside[lanes] = True
    return np.where(told, said, inside)


def _control(chosen: Sequence[Lanelet], graph: LaneGraph, crossed: Sequence[set[int]]) -> LinkControl | None:
    """Return what lights and signs say of each link; None where there are none, since then nothing is known."""
    if not any(lanelet.gives_way or lanelet.signals for lanelet in chosen):
        return None
    origin, successor = graph.link_from, graph.successor
    kind, signal = np.full(len(successor), FREE), np.full(len(successor), NO_SIGNAL)
    numbers: dict[str, int] = {}
    for k in range(len(successor)):
        lanelet = chosen[origin[k]]
        if lanelet.signals:
            name = f"{'+'.join(lanelet.signals)}:{graph.name[successor[k]]}"
            kind[k], signal[k] = SIGNAL, numbers.setdefault(name, len(numbers))
        elif lanelet.gives_way:
            kind[k] = YIELD
    entering = {int(to): np.flatnonzero(successor == to) for to in np.unique(successor)}
    ends = [set(after.tolist()) for after in np.split(successor, graph.first_successor[1:-1])]
    foes: list[list[int]] = []
    for k in range(len(successor)):
        path = int(successor[k])
        meets = crossed[path] | {other for other in range(len(graph)) if other != path and ends[other] & ends[path]}
        own = [int(link) for other in sorted(meets) for link in entering.get(other, ()) if origin[link] != origin[k]]
        # Of two that both wait neither holds the other.
        foes.append([link for link in own if kind[k] != YIELD or kind[link] != YIELD] if kind[k] != FREE else [])
    return LinkControl(
        kind=kind,
        signal=signal,
        signal_name=tuple(numbers),
        foe=np.array([link for each in foes for link in each], dtype=np.int64),
        first_foe=np.cumsum([0, *map(len, foes)]),
    )


def _middle(lanelet: Lanelet) -> FloatArray:
    """Return a lanelet's middle line without points that it would not miss by more than 5 cm, shape (p, 2)."""
    line = shapely.simplify(shapely.LineString(lanelet.centre_xy()), STRAIGHT_WITHIN_M)
    points = shapely.get_coordinates(shapely.segmentize(line, LONGEST_PIECE_M))
    steps = np.hypot(*np.diff(points, axis=0).T)
    return np.asarray(points[np.append(True, steps > SAME_POINT_M)])


def _width(lanelet: Lanelet) -> float:
    left, right = lanelet.sampled()
    return max(float(np.median(np.hypot(*(left - right).T))), NARROWEST_LANE_M)


def _chords(line: FloatArray) -> FloatArray:
    """Return how far a line leads, piece by piece of 20 m or a little less, shape (k, 2)."""
    pieces = max(1, int(np.ceil(length_of(line) / PIECE_M)))
    places = line[np.round(np.linspace(0, len(line) - 1, pieces + 1)).astype(np.int64)]
    return np.diff(places, axis=0)
