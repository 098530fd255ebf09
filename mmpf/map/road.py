"""The road protocol: where lanes are, and how the road frame maps to the Cartesian plane.

There are two kinds. ``CorridorRoad`` is one road: its right-handed frame runs along a reference line in the driving
direction and to the left of it, and lane numbers follow NGSIM: 1 is the leftmost main lane, numbers grow to the right.
``LaneGraphRoad`` has lanes of any shape: its frame is the plane, longitudinal is x, lateral is y, headings count from
the x axis, and speeds are along each vehicle's own heading. Nothing but the road itself asks which it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from mmpf.map.lane_graph import LaneGraph

NO_LANE = 0
# Only the outlines of buildings count.
WALL_WIDTH_M = 0.01
InReach = Callable[[FloatArray, FloatArray], BoolArray]
"""Whether positions are in reach, longitudinal first, each of shape (k,)."""


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


class LaneLine(NamedTuple):
    """A lane of any shape.

    Attributes:
        xy: Points of its middle line, metres, shape (p, 2).
        width_m: Its width.
        in_junction: Whether it is a path across a junction.
    """

    xy: FloatArray
    width_m: float
    in_junction: bool


class Road(Protocol):
    """What every road tells; positions are metres in its frame, of shape (n,) unless stated otherwise."""

    @property
    def section_m(self) -> tuple[float, float]:
        """Longitudinal positions at which the section that is scored starts and ends."""

    @property
    def lanes(self) -> tuple[Lane, ...]:
        """The strips along the road; none where lanes are of any shape."""

    @property
    def reference_xy(self) -> tuple[tuple[float, float], ...]:
        """Points (x, y) of the line that carries the frame, metres, at least two."""

    @property
    def reference_start_m(self) -> float:
        """Longitudinal position of that line's first point."""

    @property
    def walls_xy(self) -> FloatArray | None:
        """Walls of buildings, which hide what is behind them. A row is x and y of both ends, metres, (w, 4)."""

    @property
    def graph(self) -> LaneGraph | None:
        """Lanes of any shape; None where there are strips."""

    @property
    def has_headings(self) -> bool:
        """Whether vehicles point any way in the frame, so that the direction of each is a thing to know."""

    @property
    def signals(self) -> int:
        """How many traffic signals there are."""

    @property
    def is_straight(self) -> bool:
        """Whether the frame is the Cartesian plane up to a turn and a shift."""

    def heading_at(self, lon_m: FloatArray) -> FloatArray:
        """Return the Cartesian direction of the frame's longitudinal axis, radians, the shape of ``lon_m``."""

    def shifted(self, left_m: float) -> Road:
        """Return the road with its lanes so far to the left, of lanes of any shape towards larger y."""

    def to_cartesian(self, lon_m: FloatArray, lat_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Map positions to Cartesian x and y, metres, in the arguments' shape."""

    def to_road(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Undo ``to_cartesian`` for places of shape (n,)."""

    def axis_of(self, heading_rad: FloatArray) -> FloatArray:
        """Return along what direction, against the frame's axis, vehicles of these headings are measured, (n,)."""

    def lane_heading_at(self, lon_m: FloatArray, lat_m: FloatArray) -> FloatArray:
        """Return the Cartesian direction of the nearest lane at positions, nan where there is none, (n,)."""

    def to_stop_line_m(self, lon_m: FloatArray, lat_m: FloatArray, heading_rad: FloatArray) -> FloatArray | None:
        """How far ahead of vehicles a signal or right of way may hold them, inf for none, (n,); None if unknown."""

    def on_a_lane(self, lon_m: FloatArray, lat_m: FloatArray) -> BoolArray:
        """Return whether positions are on a lane, (n,)."""

    def speed_limit_of(self, lane: IntArray) -> FloatArray:
        """Return the speed limit, m/s, of lanes by their numbers, nan where none is known, (n,)."""

    def across_m(self, lon_m: tuple[float, float], lat_m: float, half_m: float) -> tuple[float, float]:
        """Return from where to where what lies between two longitudinal positions reaches across.

        Args:
            lon_m: The positions.
            lat_m: A lateral position between the ends, where the frame itself has none.
            half_m: How far from it they are there.
        """

    def lines(self) -> Iterator[LaneLine]:
        """Yield the lanes of any shape; strips along the road are none."""

    def walls_near(self, x: float, y: float, within_m: float) -> FloatArray:
        """Return the walls that come nearer to a place than a distance, metres, shape (k, 4)."""

    def draw_on_lanes(
        self,
        count: int,
        around: tuple[float, float],
        range_m: float,
        rng: np.random.Generator,
        in_reach: InReach | None = None,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Draw positions evenly over the lanes within range of a place, by rejection.

        Args:
            count: How many.
            around: The place.
            range_m: The range.
            rng: Source of randomness.
            in_reach: Which of those drawn count; None for all within range.

        Returns:
            Longitudinal and lateral positions and the lanes' directions against the frame's axis, each (count,); fewer
            where next to no lane is in reach.
        """

    def draw_beside_lanes(
        self, per_km: float, around: tuple[float, float], rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Draw where things stand for good, so many per km of lane; as ``draw_on_lanes`` returns them."""

    def moved(
        self, lon_m: FloatArray, lat_m: FloatArray, axis_rad: FloatArray, way_m: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return where those come that go so far along the lanes: positions and directions as before."""

    def come_round(
        self, lon_m: FloatArray, lat_m: FloatArray, ego: tuple[float, float], range_m: float
    ) -> tuple[FloatArray, BoolArray]:
        """Return longitudinal positions of things around an ego, and which of them it has not left behind.

        Along one road what is left behind comes in again at the other end of the range.
        """

    def lane_area_m2(self, range_m: float, width_m: float) -> float:
        """Return over what ground false detections spread: the lanes in range.

        Args:
            range_m: The range.
            width_m: Width of one road that is taken to go on straight.
        """


def wall_bodies(walls_xy: FloatArray) -> FloatArray:
    """Return walls as thin rectangles: rows of the middle's x and y, heading, length and width, shape (5, k).

    Args:
        walls_xy: Rows of x and y of either end, metres, shape (k, 4).
    """
    middle, step = 0.5 * (walls_xy[:, :2] + walls_xy[:, 2:]), walls_xy[:, 2:] - walls_xy[:, :2]
    length = np.hypot(step[:, 0], step[:, 1])
    return np.stack([*middle.T, np.arctan2(step[:, 1], step[:, 0]), length, np.full(len(walls_xy), WALL_WIDTH_M)])
