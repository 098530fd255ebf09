"""Lanes as a graph of lines in the plane: curves, junctions, roundabouts, both directions of traffic.

What a driver does happens on a lane of this graph; what a sensor sees happens in the plane. A place is either x and y,
or a lane with the arc length along its middle line and the offset to the left of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np

from mmpf.compute.arrays import BoolArray, FloatArray, IntArray

NOWHERE = -1
"""In place of a lane's index: no lane."""

CELL_M = 10.0
MOST_CELLS = 4_000_000
# A place farther than this beyond a lane's edge is not beside that lane.
BESIDE_M = 3.0


@dataclass(frozen=True)
class Segments:
    """The straight pieces of all lanes' middle lines, those of a lane one after the other; arrays of shape (q,).

    Attributes:
        start_x: Where each begins, metres.
        start_y: The same.
        cosine: Its direction.
        sine: The same.
        length_m: Its length.
        along_m: Arc length from the lane's beginning to its own.
        lane: Index of its lane.
        first: Index of each lane's first piece, and the number of all, shape (l + 1,).
    """

    start_x: FloatArray
    start_y: FloatArray
    cosine: FloatArray
    sine: FloatArray
    length_m: FloatArray
    along_m: FloatArray
    lane: IntArray
    first: IntArray

    def as_arrays(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return the columns that kernels take, lanes left out."""
        return self.start_x, self.start_y, self.cosine, self.sine, self.length_m, self.along_m


@dataclass(frozen=True)
class Cells:
    """Which segments may be near which places: the plane in squares.

    Attributes:
        origin: Lower left corner of the first square, metres, shape (2,).
        size_m: Their side.
        shape: How many there are along x and along y.
        first: Where each square's list begins, shape (squares + 1,).
        segment: Segments of all lists.
    """

    origin: FloatArray
    size_m: float
    shape: tuple[int, int]
    first: IntArray
    segment: IntArray


@dataclass(frozen=True)
class LanesNear:
    """Up to k lanes beside each of n places, the nearest first; arrays of shape (n, k).

    Attributes:
        lane: Index of the lane, ``NOWHERE`` where there are fewer.
        along_m: Arc length along it.
        left_m: Offset to the left of its middle line.
        heading_rad: Its direction there.
    """

    lane: IntArray
    along_m: FloatArray
    left_m: FloatArray
    heading_rad: FloatArray


@dataclass(frozen=True)
class LaneGraph:
    """The lanes of a road network, struct of arrays over l lanes.

    Attributes:
        name: What each is called, unique.
        xy: Points of all lanes' middle lines, one lane after the other, metres, shape (p, 2).
        first_point: Where each lane's points begin, and the end of the last, shape (l + 1,); two points a lane or more.
        width_m: Width of each.
        speed_limit_mps: Speed limit of each.
        left: Index of the lane to the left that leads the same way, ``NOWHERE`` if there is none.
        right: The same to the right.
        successor: Lanes that follow, of all lanes, shape (k,).
        first_successor: Where each lane's successors begin, and the end of the last, shape (l + 1,).
        in_junction: Whether the lane is a path across a junction.

    Raises:
        ValueError: Shapes don't fit, an index leads nowhere, or a lane has no length or width.
    """

    name: tuple[str, ...]
    xy: FloatArray
    first_point: IntArray
    width_m: FloatArray
    speed_limit_mps: FloatArray
    left: IntArray
    right: IntArray
    successor: IntArray
    first_successor: IntArray
    in_junction: BoolArray

    def __post_init__(self) -> None:
        lanes = len(self.name)
        if lanes == 0 or len(set(self.name)) < lanes:
            raise ValueError("a lane graph needs lanes, each with a name of its own")
        for column in ("width_m", "speed_limit_mps", "left", "right", "in_junction"):
            if getattr(self, column).shape != (lanes,):
                raise ValueError(f"lane graph: {column} has shape {getattr(self, column).shape}, not {(lanes,)}")
        for first, values in ((self.first_point, self.xy), (self.first_successor, self.successor)):
            if first.shape != (lanes + 1,) or first[0] != 0 or first[-1] != len(values) or (np.diff(first) < 0).any():
                raise ValueError("lane graph: first_point or first_successor does not divide its list up by lanes")
        if self.xy.shape[1:] != (2,) or (np.diff(self.first_point) < 2).any():
            raise ValueError("lane graph: each lane needs two points (x, y) or more")
        if not np.isfinite(self.xy).all() or not (np.isfinite(self.length_m) & (self.length_m > 0.0)).all():
            raise ValueError("lane graph: a lane has no length, or a point that is not finite")
        if not (np.isfinite(self.width_m) & (self.width_m > 0.0) & (self.speed_limit_mps > 0.0)).all():
            raise ValueError("lane graph: widths and speed limits must be positive")
        for indices, lowest in ((self.left, NOWHERE), (self.right, NOWHERE), (self.successor, 0)):
            if len(indices) and (indices.min() < lowest or indices.max() >= lanes):
                raise ValueError("lane graph: a neighbour or successor is no lane")

    def __len__(self) -> int:
        return len(self.name)

    @cached_property
    def segments(self) -> Segments:
        """The straight pieces of the lanes; points that coincide with the one before are left out."""
        step = np.diff(self.xy, axis=0)
        length = np.hypot(step[:, 0], step[:, 1])
        lane = np.repeat(np.arange(len(self)), np.diff(self.first_point))
        own = (lane[1:] == lane[:-1]) & (length > 0.0)
        lane, length, step = lane[:-1][own], length[own], step[own]
        first = np.searchsorted(lane, np.arange(len(self) + 1))
        total = np.concatenate([[0.0], np.cumsum(length)])
        return Segments(
            start_x=self.xy[:-1, 0][own],
            start_y=self.xy[:-1, 1][own],
            cosine=step[:, 0] / length,
            sine=step[:, 1] / length,
            length_m=length,
            along_m=total[:-1] - total[first[lane]],
            lane=lane,
            first=first,
        )

    @cached_property
    def length_m(self) -> FloatArray:
        """Length of each lane, metres, shape (l,)."""
        return np.asarray(np.bincount(self.segments.lane, self.segments.length_m, minlength=len(self)))

    @cached_property
    def cells(self) -> Cells:
        """The plane in squares, each with the segments that may be beside a place in it."""
        pieces = self.segments
        reach = 0.5 * self.width_m[pieces.lane] + BESIDE_M
        end_x = pieces.start_x + pieces.cosine * pieces.length_m
        end_y = pieces.start_y + pieces.sine * pieces.length_m
        low = np.stack([np.minimum(pieces.start_x, end_x), np.minimum(pieces.start_y, end_y)]) - reach
        high = np.stack([np.maximum(pieces.start_x, end_x), np.maximum(pieces.start_y, end_y)]) + reach
        origin, extent = low.min(axis=1), high.max(axis=1) - low.min(axis=1)
        size_m = max(CELL_M, float(np.sqrt(extent.prod() / MOST_CELLS)))
        shape = int(extent[0] / size_m) + 1, int(extent[1] / size_m) + 1
        first_cell = ((low - origin[:, None]) / size_m).astype(np.int64)
        last_cell = ((high - origin[:, None]) / size_m).astype(np.int64)
        first, segment = _fill_cells(first_cell, last_cell, shape)
        return Cells(origin, size_m, shape, first, segment)

    def lanes_near(self, x: FloatArray, y: FloatArray, most: int = 6) -> LanesNear:
        """Return the lanes beside places: those within half their width and 3 m of their middle lines.

        Args:
            x: Places, metres, shape (n,).
            y: The same.
            most: k, how many lanes of each at most.
        """
        shape = len(x), most
        found = LanesNear(np.full(shape, NOWHERE), np.zeros(shape), np.zeros(shape), np.zeros(shape))
        cells = self.cells
        _find_lanes(
            x,
            y,
            cells.origin,
            cells.size_m,
            cells.shape,
            cells.first,
            cells.segment,
            self.segments.as_arrays(),
            self.segments.lane,
            0.5 * self.width_m + BESIDE_M,
            found.lane,
            found.along_m,
            found.left_m,
            found.heading_rad,
        )
        return found

    def lane_at(self, x: FloatArray, y: FloatArray, heading_rad: FloatArray) -> IntArray:
        """Return the lane that vehicles are on: the nearest beside them that leads their way, (n,), or ``NOWHERE``.

        Args:
            x: Places, metres, shape (n,).
            y: The same.
            heading_rad: Where the vehicles point, shape (n,).
        """
        near = self.lanes_near(x, y)
        off = np.abs(np.remainder(near.heading_rad - heading_rad[:, None] + np.pi, 2.0 * np.pi) - np.pi)
        # Half a turn off weighs as much as being a whole lane beside it.
        cost = np.where(near.lane >= 0, np.abs(near.left_m) + 3.0 * off, np.inf)
        cost[off > 0.5 * np.pi] = np.inf
        best = cost.argmin(axis=1)
        rows = np.arange(len(x))
        return np.where(np.isfinite(cost[rows, best]), near.lane[rows, best], NOWHERE)

    def on_lane(self, lane: IntArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return arc length, offset to the left and direction of places on given lanes, each (n,); nan off every lane.

        The lane's first and last piece go on straight beyond its ends, so that an arc length may be negative or exceed
        the lane's.

        Args:
            lane: Index of the lane that each place belongs to, or ``NOWHERE``, shape (n,).
            x: Places, metres, shape (n,).
            y: The same.
        """
        along, left, heading = (np.full(len(x), np.nan) for _ in range(3))
        _project(lane, x, y, self.segments.as_arrays(), self.segments.first, along, left, heading)
        return along, left, heading

    def place(
        self, lane: IntArray, along_m: FloatArray, left_m: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return x, y and direction of places on lanes, each (n,): the inverse of ``on_lane``; nan off every lane.

        Args:
            lane: Index of the lane, or ``NOWHERE``, shape (n,).
            along_m: Arc length, shape (n,).
            left_m: Offset to the left of its middle line, shape (n,).
        """
        x, y, heading = (np.full(len(along_m), np.nan) for _ in range(3))
        _lay_out(lane, along_m, left_m, self.segments.as_arrays(), self.segments.first, x, y, heading)
        return x, y, heading


_Pieces = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]


@numba.njit(cache=True)
def _fill_cells(first_cell: IntArray, last_cell: IntArray, shape: tuple[int, int]) -> tuple[IntArray, IntArray]:
    count = np.zeros(shape[0] * shape[1] + 1, dtype=np.int64)
    for fill in range(2):
        if fill:
            begin = np.cumsum(count)
            segment = np.empty(begin[-1], dtype=np.int64)
            place = begin - count
        for q in range(first_cell.shape[1]):
            for column in range(first_cell[0, q], last_cell[0, q] + 1):
                for row in range(first_cell[1, q], last_cell[1, q] + 1):
                    cell = column * shape[1] + row
                    if fill:
                        segment[place[cell]] = q
                        place[cell] += 1
                    else:
                        count[cell] += 1
    return begin - count, segment


@numba.njit(cache=True)
def _find_lanes(
    x: FloatArray,
    y: FloatArray,
    origin: FloatArray,
    size_m: float,
    shape: tuple[int, int],
    first: IntArray,
    members: IntArray,
    pieces: _Pieces,
    piece_lane: IntArray,
    reach_m: FloatArray,
    lane: IntArray,
    along: FloatArray,
    left: FloatArray,
    heading: FloatArray,
) -> None:
    start_x, start_y, cosine, sine, length, piece_along = pieces
    most = lane.shape[1]
    distance = np.empty(most)
    for n in range(len(x)):
        column, row = int(np.floor((x[n] - origin[0]) / size_m)), int(np.floor((y[n] - origin[1]) / size_m))
        if not (0 <= column < shape[0] and 0 <= row < shape[1]):
            continue
        cell, found = column * shape[1] + row, 0
        for place in range(first[cell], first[cell + 1]):
            q = members[place]
            away_x, away_y = x[n] - start_x[q], y[n] - start_y[q]
            t = min(max(away_x * cosine[q] + away_y * sine[q], 0.0), length[q])
            off_x, off_y = away_x - t * cosine[q], away_y - t * sine[q]
            away = np.sqrt(off_x * off_x + off_y * off_y)
            if away > reach_m[piece_lane[q]]:
                continue
            # One entry a lane: a nearer piece of a lane that is listed takes its place.
            at = found
            for k in range(found):
                if lane[n, k] == piece_lane[q]:
                    at = k
                    break
            if at < found:
                if away >= distance[at]:
                    continue
            elif found < most:
                found += 1
            else:
                at = most - 1
                if away >= distance[at]:
                    continue
            while at > 0 and distance[at - 1] > away:
                lane[n, at], along[n, at], left[n, at] = lane[n, at - 1], along[n, at - 1], left[n, at - 1]
                heading[n, at], distance[at] = heading[n, at - 1], distance[at - 1]
                at -= 1
            lane[n, at], along[n, at], distance[at] = piece_lane[q], piece_along[q] + t, away
            left[n, at] = away if off_y * cosine[q] - off_x * sine[q] >= 0.0 else -away
            heading[n, at] = np.arctan2(sine[q], cosine[q])


@numba.njit(cache=True, nogil=True)
def _project(
    lane: IntArray,
    x: FloatArray,
    y: FloatArray,
    pieces: _Pieces,
    first: IntArray,
    along: FloatArray,
    left: FloatArray,
    heading: FloatArray,
) -> None:
    start_x, start_y, cosine, sine, length, piece_along = pieces
    for n in range(len(x)):
        if lane[n] < 0:
            continue
        nearest = np.inf
        begin, end = first[lane[n]], first[lane[n] + 1]
        for q in range(begin, end):
            away_x, away_y = x[n] - start_x[q], y[n] - start_y[q]
            t = away_x * cosine[q] + away_y * sine[q]
            if q > begin:
                t = max(t, 0.0)
            if q < end - 1:
                t = min(t, length[q])
            off_x, off_y = away_x - t * cosine[q], away_y - t * sine[q]
            away = off_x * off_x + off_y * off_y
            if away < nearest:
                nearest = away
                along[n] = piece_along[q] + t
                left[n] = np.sqrt(away) if off_y * cosine[q] - off_x * sine[q] >= 0.0 else -np.sqrt(away)
                heading[n] = np.arctan2(sine[q], cosine[q])


@numba.njit(cache=True, nogil=True)
def _lay_out(
    lane: IntArray,
    along: FloatArray,
    left: FloatArray,
    pieces: _Pieces,
    first: IntArray,
    x: FloatArray,
    y: FloatArray,
    heading: FloatArray,
) -> None:
    start_x, start_y, cosine, sine, _, piece_along = pieces
    for n in range(len(along)):
        if lane[n] < 0:
            continue
        q = first[lane[n]]
        while q + 1 < first[lane[n] + 1] and along[n] >= piece_along[q + 1]:
            q += 1
        t = along[n] - piece_along[q]
        x[n] = start_x[q] + t * cosine[q] - left[n] * sine[q]
        y[n] = start_y[q] + t * sine[q] + left[n] * cosine[q]
        heading[n] = np.arctan2(sine[q], cosine[q])
