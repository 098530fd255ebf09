"""The road frame: where lanes lie, and how the frame maps to the Cartesian plane.

The road frame is right-handed. The longitudinal coordinate runs along a reference line in the driving direction,
the lateral one to the left of it. Lane numbers follow NGSIM: 1 is the leftmost main lane, numbers grow to the right.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mmpf.numerics.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    from mmpf.map.lane_graph import LaneGraph

NO_LANE = 0
# A segment that faces a position goes before one that is nearer but does not.
FACING_FIRST = 1e6
# Only the outlines of buildings count.
WALL_WIDTH_M = 0.01


@dataclass(frozen=True)
class Lane:
    """A strip of the road that one file of vehicles uses.

    Attributes:
        number: 1 for the leftmost main lane, growing to the right.
        right_m: Lateral position of the right lane line, metres.
        left_m: Lateral position of the left lane line, metres; greater than ``right_m``.
        start_m: Longitudinal position where the lane begins, metres; minus infinity for one without a beginning.
        end_m: Longitudinal position where the lane ends, metres; infinity for one without an end.
    """

    number: int
    right_m: float
    left_m: float
    start_m: float = -np.inf
    end_m: float = np.inf

    @property
    def centre_m(self) -> float:
        """Lateral position of the lane's middle, metres."""
        return 0.5 * (self.right_m + self.left_m)


@dataclass(frozen=True)
class Road:
    """Lanes in the road frame and the reference line that carries the frame.

    Attributes:
        lanes: The lanes in any order; they may overlap nowhere.
        reference_xy: Points (x, y) of the reference line in the Cartesian plane, metres, at least two. Beyond its ends
            it goes on straight.
        reference_start_m: Longitudinal position of the line's first point, metres.
        section_m: Longitudinal positions, metres, at which the section that is scored starts and ends.
        graph: Lanes of any shape. With them the road frame is the Cartesian plane itself: longitudinal is x, lateral is
            y, headings count from the x axis, speeds are along each vehicle's own heading, and there are no ``lanes``.
        walls_xy: Walls of buildings, which hide what is behind them: rows of x and y of either end, metres, (w, 4);
            only beside a graph.
    """

    lanes: tuple[Lane, ...]
    reference_xy: tuple[tuple[float, float], ...] = ((0.0, 0.0), (1.0, 0.0))
    reference_start_m: float = 0.0
    section_m: tuple[float, float] = (0.0, 640.0)
    graph: LaneGraph | None = None
    walls_xy: FloatArray | None = None

    def walls_near(self, x: float, y: float, within_m: float) -> FloatArray:
        """Return the walls that come nearer to a place than a distance, metres, shape (k, 4)."""
        if self.walls_xy is None:
            return np.zeros((0, 4))
        start, step = self.walls_xy[:, :2] - (x, y), self.walls_xy[:, 2:] - self.walls_xy[:, :2]
        share = -(start * step).sum(axis=1) / np.maximum((step * step).sum(axis=1), 1e-12)
        nearest = start + np.clip(share, 0.0, 1.0)[:, None] * step
        return np.asarray(self.walls_xy[np.hypot(nearest[:, 0], nearest[:, 1]) < within_m])

    @cached_property
    def _vertices(self) -> FloatArray:
        return np.asarray(self.reference_xy, dtype=np.float64)

    @cached_property
    def _segment_headings(self) -> FloatArray:
        steps = np.diff(self._vertices, axis=0)
        return np.arctan2(steps[:, 1], steps[:, 0])

    @cached_property
    def _vertex_lon(self) -> FloatArray:
        lengths = np.hypot(*np.diff(self._vertices, axis=0).T)
        return self.reference_start_m + np.concatenate([[0.0], np.cumsum(lengths)])

    @cached_property
    def _segment_lengths(self) -> FloatArray:
        return np.diff(self._vertex_lon)

    @cached_property
    def _mitres(self) -> tuple[FloatArray, FloatArray]:
        """How far each segment's start and end shift along it per metre to the left, so that parallels join up."""
        half_turn = np.tan(0.5 * np.diff(self._segment_headings))
        return np.concatenate([[0.0], half_turn]), np.concatenate([-half_turn, [0.0]])

    @property
    def is_straight(self) -> bool:
        """Whether the frame is the Cartesian plane up to a turn and a shift."""
        return len(self.reference_xy) == 2

    def _segment_at(self, lon_m: FloatArray) -> IntArray:
        return np.asarray(np.searchsorted(self._vertex_lon[1:-1], lon_m, side="right"))

    def heading_at(self, lon_m: FloatArray) -> FloatArray:
        """Return the Cartesian direction of the reference line, radians counter-clockwise, the shape of ``lon_m``."""
        return np.asarray(self._segment_headings[self._segment_at(lon_m)])

    def to_cartesian(self, lon_m: FloatArray, lat_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Map road-frame positions, metres, to Cartesian x and y, metres, in the arguments' shape.

        Parallels of the reference line bend with it and are mitred at its vertices, so that the map has neither gaps
        nor overlaps up to the line's radius of curvature.
        """
        segment = self._segment_at(lon_m)
        heading = self._segment_headings[segment]
        along = lon_m - self._vertex_lon[segment]
        start, end = self._mitres
        share = np.clip(along / self._segment_lengths[segment], 0.0, 1.0)
        along = along + lat_m * (start[segment] + (end - start)[segment] * share)
        origin = self._vertices[segment]
        x = origin[..., 0] + along * np.cos(heading) - lat_m * np.sin(heading)
        y = origin[..., 1] + along * np.sin(heading) + lat_m * np.cos(heading)
        return x, y

    def to_road(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Undo ``to_cartesian``: map x and y, metres, (n,), to longitudinal and lateral position, metres, each (n,).

        Where several segments face a position the nearest counts.
        """
        cosine, sine = np.cos(self._segment_headings), np.sin(self._segment_headings)
        offset_x = np.asarray(x)[:, None] - self._vertices[None, :-1, 0]
        offset_y = np.asarray(y)[:, None] - self._vertices[None, :-1, 1]
        along = offset_x * cosine + offset_y * sine
        across = -offset_x * sine + offset_y * cosine
        start, end = self._mitres
        lower, upper = across * start, self._segment_lengths + across * end
        share = np.clip((along - lower) / np.maximum(upper - lower, 1e-9), 0.0, 1.0)
        lower[:, 0], upper[:, -1] = -np.inf, np.inf
        overshoot = np.abs(along - np.clip(along, lower, np.maximum(lower, upper)))
        nearest = np.argmin(np.abs(across) + FACING_FIRST * overshoot, axis=1)
        rows = np.arange(len(nearest))
        shift = across * (start + (end - start) * share)
        return self._vertex_lon[nearest] + (along - shift)[rows, nearest], across[rows, nearest]

    @cached_property
    def lane_table(self) -> FloatArray:
        """The lanes as rows of (number, right, left, start, end), metres, shape (lanes, 5), for compiled loops."""
        return np.array([[ln.number, ln.right_m, ln.left_m, ln.start_m, ln.end_m] for ln in self.lanes])

    def lane_index_at(self, lon_m: FloatArray, lat_m: FloatArray) -> IntArray:
        """Return the index into ``lanes`` of each position's lane, -1 off the road; positions in metres, all (n,)."""
        _, right, left, start, end = self.lane_table.T
        inside = (
            (lat_m[:, None] >= right) & (lat_m[:, None] < left) & (lon_m[:, None] >= start) & (lon_m[:, None] < end)
        )
        return np.where(inside.any(axis=1), inside.argmax(axis=1), -1)

    def lane_number_at(self, lon_m: FloatArray, lat_m: FloatArray) -> IntArray:
        """Return each position's lane number, ``NO_LANE`` (0) off the road; positions in metres, all (n,)."""
        index = self.lane_index_at(lon_m, lat_m)
        numbers = np.append(self.lane_table[:, 0], NO_LANE).astype(np.int64)
        return numbers[index]


def wall_bodies(walls_xy: FloatArray) -> FloatArray:
    """Return walls as thin rectangles: rows of the middle's x and y, heading, length and width, shape (5, k).

    Args:
        walls_xy: Rows of x and y of either end, metres, shape (k, 4).
    """
    middle, step = 0.5 * (walls_xy[:, :2] + walls_xy[:, 2:]), walls_xy[:, 2:] - walls_xy[:, :2]
    length = np.hypot(step[:, 0], step[:, 1])
    return np.stack([*middle.T, np.arctan2(step[:, 1], step[:, 0]), length, np.full(len(walls_xy), WALL_WIDTH_M)])


def highway(lanes: int = 5, lane_width_m: float = 3.66, section_m: tuple[float, float] = (0.0, 640.0)) -> Road:
    """Return a straight one-way road whose right edge lies at lateral position zero.

    Args:
        lanes: Number of lanes, without beginning or end.
        lane_width_m: Width of each, metres.
        section_m: Longitudinal positions, metres, at which the section that is scored starts and ends.
    """
    strips = tuple(
        Lane(number=lanes - k, right_m=k * lane_width_m, left_m=(k + 1) * lane_width_m) for k in range(lanes)
    )
    return Road(lanes=strips, section_m=section_m)
