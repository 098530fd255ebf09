"""Where the ego's route over a lane graph meets routes that have right of way over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.decisions.routes import Line, next_lane, predecessors
from mmpf.map.control import YIELD
from mmpf.map.lane_graph import LaneGraph
from mmpf.numerics.arrays import FloatArray

APPROACH_M = 200.0
"""So far before a junction ways that have right of way are known."""
MEET_M = 2.5
"""Where the middles of two ways are nearer, vehicles on them meet; oncoming lanes are 3 m apart or more."""
SAMPLE_M = 0.5
SAME_END_M = 1.0


@dataclass(frozen=True)
class LaneChain:
    """Consecutive lanes as one line, with each one's speed limit, shape (l,).

    ``begins_m`` is the arc length of each lane's beginning, and of the last one's end, shape (l + 1,).
    """

    lanes: tuple[int, ...]
    line: Line
    begins_m: FloatArray
    limit_mps: FloatArray

    @classmethod
    def of(cls, graph: LaneGraph, lanes: Sequence[int]) -> LaneChain:
        """Return the lanes of a graph as one line."""
        lines = [graph.line(lane) for lane in lanes]
        points = np.concatenate(lines)
        along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        first = np.cumsum([0, *map(len, lines)])
        return cls(
            lanes=tuple(lanes),
            line=Line.through(points),
            begins_m=np.append(along_m[first[:-1]], along_m[-1]),
            limit_mps=graph.speed_limit_mps[list(lanes)],
        )

    def sampled(self, from_m: float, to_m: float) -> tuple[FloatArray, FloatArray]:
        """Return arc lengths and places of a stretch, shapes (k,) and (k, 2)."""
        along_m = np.linspace(from_m, to_m, max(int((to_m - from_m) / SAMPLE_M), 1) + 1)
        line = self.line
        piece = np.clip(np.searchsorted(line.along_m, along_m, side="right") - 1, 0, len(line.length_m) - 1)
        share = (along_m - line.along_m[piece]) / line.length_m[piece]
        return along_m, line.xy[piece] + share[:, None] * line.step[piece]


@dataclass(frozen=True)
class Conflict:
    """The place where a way with right of way, from its approach through the junction, meets the ego's.

    It goes from where to where on either way, in metres; ``merges`` if both leave the junction by the same lane.
    """

    route: LaneChain
    own_m: tuple[float, float]
    other_m: tuple[float, float]
    merges: bool


@dataclass(frozen=True)
class Crossing:
    """A place on the ego's way where it must yield: arc length of the stop line, and the conflicts behind it."""

    stop_m: float
    conflicts: tuple[Conflict, ...]

    @property
    def begins_m(self) -> float:
        """Arc length on the ego's route at which the conflict area begins."""
        return min(conflict.own_m[0] for conflict in self.conflicts)

    @property
    def ends_m(self) -> float:
        """Arc length at which the conflict area ends."""
        return max(conflict.own_m[1] for conflict in self.conflicts)


def crossings_of(graph: LaneGraph, route: LaneChain) -> tuple[Crossing, ...]:
    """Return the places on a way where it must yield, the nearest first."""
    control = graph.control
    if control is None or not (links := yields_on(graph, route)):
        return ()
    before = predecessors(graph)
    found = []
    for place, link in links:
        foes = control.foe[control.first_foe[link] : control.first_foe[link + 1]].tolist()
        others = (_conflict(graph, route, place, _route_over(graph, foe, before)) for foe in foes)
        if conflicts := tuple(other for other in others if other is not None):
            found.append(Crossing(float(route.begins_m[place]), conflicts))
    return tuple(found)


def yields_on(graph: LaneGraph, route: LaneChain) -> list[tuple[int, int]]:
    """Return the links on a route that must yield, each with the place on the route of the lane that it leads to."""
    found = []
    for place, (lane, following) in enumerate(zip(route.lanes, route.lanes[1:], strict=False), start=1):
        links = np.arange(graph.first_successor[lane], graph.first_successor[lane + 1])
        link = int(links[graph.successor[links] == following][0])
        if graph.control is not None and graph.control.kind[link] == YIELD:
            found.append((place, link))
    return found


def _route_over(graph: LaneGraph, link: int, before: list[list[int]]) -> LaneChain:
    """Return the route over a link: as straight an approach as there is, and the junction."""
    lanes = [int(graph.link_from[link]), int(graph.successor[link])]
    while graph.in_junction[lanes[-1]]:
        at = lanes[-1]
        following = graph.successor[graph.first_successor[at] : graph.first_successor[at + 1]].tolist()
        if not following or not graph.in_junction[chosen := next_lane(at, following, set(), graph)]:
            break
        lanes.append(chosen)
    ahead_m = float(graph.length_m[lanes[0]])
    while ahead_m < APPROACH_M and before[lanes[0]]:
        lanes.insert(0, next_lane(lanes[0], before[lanes[0]], set(lanes), graph, back=True))
        ahead_m += float(graph.length_m[lanes[0]])
    return LaneChain.of(graph, lanes)


def _conflict(graph: LaneGraph, route: LaneChain, place: int, other: LaneChain) -> Conflict | None:
    """Return where another way meets the ego's from one of its lanes on to the junction's end; None for nowhere."""
    end = place
    while end < len(route.lanes) and graph.in_junction[route.lanes[end]]:
        end += 1
    own_m, own = route.sampled(float(route.begins_m[place]), float(route.begins_m[max(end, place + 1)]))
    entry = len(other.lanes) - 1
    while entry and graph.in_junction[other.lanes[entry - 1]]:
        entry -= 1
    other_m, theirs = other.sampled(float(other.begins_m[entry]), float(other.begins_m[-1]))
    apart_m = np.hypot(*(own[:, None] - theirs).transpose(2, 0, 1))
    meet = apart_m < MEET_M
    if not meet.any():
        return None
    mine, its = own_m[meet.any(axis=1)], other_m[meet.any(axis=0)]
    return Conflict(
        route=other,
        own_m=(float(mine[0]), float(mine[-1])),
        other_m=(float(its[0]), float(its[-1])),
        merges=bool(apart_m[-1, -1] < SAME_END_M),
    )
