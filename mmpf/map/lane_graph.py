"""Lanes as a graph of lines in the plane: curves, junctions, roundabouts, both directions of traffic.

What a driver does happens on a lane of this graph; what a sensor sees happens in the plane. A place is either x and y,
or a lane with the arc length along its middle line and the offset to the left of it.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mmpf.map.control import FREE, LinkControl
from mmpf.map.finding import Cells, LanesNear, Segments, fill_cells, find_lanes, lay_out, project
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, wrapped

NOWHERE = -1
"""In place of a lane's index: no lane."""

NO_LIMIT_MPS = 130.0 / 3.6
"""In place of an unknown speed limit. A limit from this on says nothing of how fast a lane is driven."""

NO_MAP = "no map"
NO_MAP_AT_M = 1e7

CELL_M = 10.0
MOST_CELLS = 4_000_000
# A place farther than this beyond a lane's edge is not beside that lane.
BESIDE_M = 3.0


class LaneColumns(NamedTuple):
    """What compiled loops take of a ``LaneGraph``, whose attributes these are."""

    length_m: FloatArray
    width_m: FloatArray
    left: IntArray
    right: IntArray
    successor: IntArray
    first_successor: IntArray
    link_from: IntArray
    in_junction: BoolArray


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
        control: Signals and right of way, link by link as in ``successor``; None where they are not known.

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
    control: LinkControl | None = None

    def __post_init__(self) -> None:
        lanes = len(self.name)
        if lanes == 0 or len(set(self.name)) < lanes:
            raise ValueError("a lane graph needs lanes with unique names")
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
                raise ValueError("lane graph: a neighbour or successor is not a lane")
        if self.control is not None and len(self.control.kind) != len(self.successor):
            raise ValueError("lane graph: control does not have a place for each successor")

    def __len__(self) -> int:
        return len(self.name)

    @property
    def has_map(self) -> bool:
        """Whether anything is known of lanes; see ``without_map``."""
        return self.name != (NO_MAP,)

    @property
    def states_limits(self) -> bool:
        """Whether any lane's speed limit is known."""
        return self.has_map and bool((self.speed_limit_mps < NO_LIMIT_MPS).any())

    @property
    def signals(self) -> int:
        """How many signals there are."""
        return 0 if self.control is None else len(self.control.signal_name)

    def line(self, lane: int) -> FloatArray:
        """Return the points of a lane's middle line, metres, shape (p, 2)."""
        return self.xy[self.first_point[lane] : self.first_point[lane + 1]]

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
    def curvature_per_m(self) -> FloatArray:
        """Mean curvature of each lane, whichever way it bends, shape (l,)."""
        pieces = self.segments
        bend = np.abs(wrapped(np.diff(np.arctan2(pieces.sine, pieces.cosine))))
        within = pieces.lane[1:] == pieces.lane[:-1]
        total = np.bincount(pieces.lane[1:][within], bend[within], minlength=len(self))
        return np.asarray(total / self.length_m)

    @cached_property
    def link_from(self) -> IntArray:
        """The lane that each link leads from, shape (k,); ``successor`` says where to."""
        return np.repeat(np.arange(len(self)), np.diff(self.first_successor))

    @cached_property
    def columns(self) -> LaneColumns:
        """What compiled loops take of the graph."""
        return LaneColumns(*(getattr(self, name) for name in LaneColumns._fields))

    @cached_property
    def to_stop_line_m(self) -> FloatArray:
        """From each lane's end to the nearest place ahead where a signal or right of way may hold vehicles, (l,).

        Infinite where none is ahead, or none is known.
        """
        away = np.full(len(self), np.inf)
        if self.control is None:
            return away
        away[self.link_from[self.control.kind != FREE]] = 0.0
        for _ in range(len(self)):
            nearer = away.copy()
            np.minimum.at(nearer, self.link_from, away[self.successor] + self.length_m[self.successor])
            if (nearer == away).all():
                break
            away = nearer
        return away

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
        first, segment = fill_cells(first_cell, last_cell, shape)
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
        find_lanes(x, y, self.cells, self.segments, 0.5 * self.width_m + BESIDE_M, found)
        return found

    def lane_at(self, x: FloatArray, y: FloatArray, heading_rad: FloatArray) -> IntArray:
        """Return the lane that vehicles are on: the nearest beside them that leads their way, (n,), or ``NOWHERE``.

        Args:
            x: Places, metres, shape (n,).
            y: The same.
            heading_rad: Where the vehicles point, shape (n,).
        """
        near = self.lanes_near(x, y)
        off = np.abs(wrapped(near.heading_rad - heading_rad[:, None]))
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
        project(lane, x, y, self.segments, along, left, heading)
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
        lay_out(lane, along_m, left_m, self.segments, x, y, heading)
        return x, y, heading


def without_map() -> LaneGraph:
    """Return what stands for a plane of which no lanes are known: one short lane, farther away than anybody drives."""
    none, start = np.array([NOWHERE]), NO_MAP_AT_M
    return LaneGraph(
        name=(NO_MAP,),
        xy=np.array([[start, start], [start + 1.0, start]]),
        first_point=np.array([0, 2]),
        width_m=np.ones(1),
        speed_limit_mps=np.ones(1),
        left=none,
        right=none,
        successor=np.zeros(0, dtype=np.int64),
        first_successor=np.zeros(2, dtype=np.int64),
        in_junction=np.zeros(1, dtype=np.bool_),
    )


def compile_kernels() -> None:
    """Compile what places vehicles on lanes, or load it: for processes that can't keep what they compile themselves."""
    graph, one, lane = without_map(), np.ones(1), np.zeros(1, dtype=np.int64)
    graph.lanes_near(one, one)
    graph.on_lane(lane, one, one)
    graph.place(lane, one, one)
