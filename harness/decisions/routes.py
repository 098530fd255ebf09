"""The ego's lane on a lane graph with the lanes before and after it, as one line.

At a fork the route goes where the ego goes later in its stay, which its driver knows. Where that is not on record it
goes as straight on as it can.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from harness.decisions.bodies import Bodies, Egos
from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, wrapped

AHEAD_M, BEHIND_M = 200.0, 120.0
MOST_LANES = 64


@dataclass(frozen=True)
class Line:
    """A line of q straight pieces: where each begins and the step to its end, shape (q, 2), and its length, shape (q,).

    ``along_m`` is the arc length up to its beginning, shape (q,).
    """

    xy: FloatArray
    step: FloatArray
    length_m: FloatArray
    along_m: FloatArray

    @classmethod
    def through(cls, points: FloatArray) -> Line:
        """Return the line through points, shape (p, 2); equal neighbours count once."""
        step = np.diff(points, axis=0)
        length = np.hypot(step[:, 0], step[:, 1])
        keep = length > 1e-9
        step, length = step[keep], length[keep]
        return cls(points[:-1][keep], step, length, np.cumsum(length) - length)

    def project(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return arc length, offset to the left and direction of the line at the nearest place, each (k,)."""
        off_x, off_y = x[:, None] - self.xy[:, 0], y[:, None] - self.xy[:, 1]
        cosine, sine = self.step[:, 0] / self.length_m, self.step[:, 1] / self.length_m
        along, across = off_x * cosine + off_y * sine, off_y * cosine - off_x * sine
        inside = np.clip(along, 0.0, self.length_m)
        nearest = np.hypot(along - inside, across).argmin(axis=1)
        rows = np.arange(len(x))
        # Beyond the ends the line goes on straight.
        first, last = nearest == 0, nearest == len(self.length_m) - 1
        piece, whole = inside[rows, nearest], along[rows, nearest]
        piece = np.where((first & (whole < 0.0)) | (last & (whole > piece)), whole, piece)
        left = across[rows, nearest]
        return self.along_m[nearest] + piece, left, np.arctan2(sine, cosine)[nearest]


@dataclass(frozen=True)
class RouteLines:
    """The route through the ego's own lane, or one beside it, at each of n steps.

    Attributes:
        exists: Whether there is one, shape (n,).
        half_width_m: Half its lane's width, shape (n,).
        ego_across_m: How far left of it the ego is, shape (n,).
        ego_along_m: Arc length of the ego on it, shape (n,).
        line: Which of ``lines`` it is, shape (n,).
        lines: The lines.
    """

    exists: BoolArray
    half_width_m: FloatArray
    ego_across_m: FloatArray
    ego_along_m: FloatArray
    line: IntArray
    lines: list[Line] = field(default_factory=list)

    def place(self, egos: Egos, bodies: Bodies, within_m: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return how far ahead of the ego and left of its route bodies near it are, and their speeds along it, (m,).

        Each is projected on the route of its step; nan of a body that is not near, or has no route.
        """
        away = np.hypot(bodies.lon_m - egos.lon_m[bodies.step], bodies.lat_m - egos.lat_m[bodies.step])
        near = (away <= within_m) & self.exists[bodies.step]
        ahead_m, across_m, speed_mps = (np.full(len(bodies), np.nan) for _ in range(3))
        for number, line in enumerate(self.lines):
            body = np.flatnonzero(near & (self.line[bodies.step] == number))
            along, across_m[body], heading = line.project(bodies.lon_m[body], bodies.lat_m[body])
            ahead_m[body] = along - self.ego_along_m[bodies.step[body]]
            turn = bodies.direction_rad[body] - heading
            # What is heading nowhere in particular is taken to go along.
            speed_mps[body] = np.where(np.isfinite(turn), np.cos(turn), 1.0) * bodies.speed_mps[body]
        return ahead_m, across_m, speed_mps


def route_lines(egos: Egos, graph: LaneGraph) -> tuple[RouteLines, RouteLines, RouteLines]:
    """Return the routes through the ego's lane, the one to its left and the one to its right."""
    lane = _kept_through_gaps(np.where(egos.lane > 0, egos.lane - 1, NOWHERE), egos.episode)
    before = predecessors(graph)
    sides = []
    for beside in (np.arange(len(graph)), graph.left, graph.right):
        of_lane = np.where(lane == NOWHERE, NOWHERE, beside[lane])
        sides.append(_through(egos, of_lane, lane, graph, before))
    return sides[0], sides[1], sides[2]


def _through(egos: Egos, lane: IntArray, own: IntArray, graph: LaneGraph, before: list[list[int]]) -> RouteLines:
    count = len(egos)
    found = RouteLines(
        exists=lane != NOWHERE,
        half_width_m=np.full(count, np.nan),
        ego_across_m=np.full(count, np.nan),
        ego_along_m=np.full(count, np.nan),
        line=np.full(count, -1),
    )
    for episode in np.unique(egos.episode):
        here = egos.episode == episode
        taken = {*own[here].tolist(), *egos.route}
        for number in np.unique(lane[here & found.exists]).tolist():
            at = np.flatnonzero(here & (lane == number))
            line = Line.through(_points(number, taken, graph, before))
            found.line[at] = len(found.lines)
            found.lines.append(line)
            found.half_width_m[at] = 0.5 * graph.width_m[number]
            along, across, _ = line.project(egos.lon_m[at], egos.lat_m[at])
            found.ego_along_m[at], found.ego_across_m[at] = along, across
    return found


def _points(lane: int, taken: set[int], graph: LaneGraph, before: list[list[int]]) -> FloatArray:
    """Return the points of the route through a lane, shape (p, 2)."""
    lanes, ahead, at = [lane], float(graph.length_m[lane]), lane
    while ahead < AHEAD_M + graph.length_m[lane] and len(lanes) < MOST_LANES:
        following = graph.successor[graph.first_successor[at] : graph.first_successor[at + 1]].tolist()
        if not following:
            break
        at = next_lane(at, following, taken, graph)
        lanes.append(at)
        ahead += float(graph.length_m[at])
    behind, at = 0.0, lane
    while behind < BEHIND_M and before[at] and len(lanes) < 2 * MOST_LANES:
        at = next_lane(at, before[at], taken, graph, back=True)
        lanes.insert(0, at)
        behind += float(graph.length_m[at])
    return np.concatenate([graph.line(number) for number in lanes])


def next_lane(lane: int, others: list[int], taken: set[int], graph: LaneGraph, back: bool = False) -> int:
    """Return the next lane of a route: one that the ego takes, one beside it, or the straightest."""

    def rank(other: int) -> tuple[int, float]:
        beside = {int(graph.left[other]), int(graph.right[other])} & taken
        first, second = (other, lane) if back else (lane, other)
        bend = abs(float(wrapped(np.array(_heading(second, graph) - _heading(first, graph)))))
        return (0 if other in taken else 1 if beside else 2), bend

    return min(others, key=rank)


def _heading(lane: int, graph: LaneGraph) -> float:
    """Return the direction from a lane's beginning to its end."""
    start, end = graph.line(lane)[[0, -1]]
    return float(np.arctan2(end[1] - start[1], end[0] - start[0]))


def predecessors(graph: LaneGraph) -> list[list[int]]:
    """Return the lanes that lead to each lane."""
    before: list[list[int]] = [[] for _ in range(len(graph))]
    for lane in range(len(graph)):
        for other in graph.successor[graph.first_successor[lane] : graph.first_successor[lane + 1]].tolist():
            before[other].append(lane)
    return before


def _kept_through_gaps(lane: IntArray, episode: IntArray) -> IntArray:
    """Return lanes with each gap filled by the lane before it in the same stay, shape (n,)."""
    rows = np.arange(len(lane))
    last = np.maximum.accumulate(np.where(lane != NOWHERE, rows, -1)) if len(lane) else rows
    known = (last >= 0) & (episode[last] == episode)
    return np.where(known, lane[last], NOWHERE)
