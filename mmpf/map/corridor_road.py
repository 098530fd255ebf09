"""One road: lanes along a reference line, in a frame that bends with it."""

# ruff: noqa: ARG002  (a road of one kind needs less than roads are told)
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar

import numpy as np

from mmpf.map.reference_line import STRAIGHT, OnReferenceLine
from mmpf.map.road import NO_LANE, InReach, Lane, LaneLine
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

MOST_DRAWINGS = 100
LONGEST_ROAD_M = 5000.0
"""Things stand along a road without end up to so far away."""


@dataclass(frozen=True)
class CorridorRoad(OnReferenceLine):
    """Lanes along a reference line that carries the frame; see ``mmpf.map.road.Road``.

    Attributes:
        lanes: The lanes in any order; they may overlap nowhere.
        reference_xy: Points (x, y) of the reference line in the Cartesian plane, metres, at least two. Beyond its ends
            it goes on straight.
        reference_start_m: Longitudinal position of the line's first point, metres.
        section_m: Longitudinal positions, metres, at which the section that is scored starts and ends.
    """

    lanes: tuple[Lane, ...]
    reference_xy: tuple[tuple[float, float], ...] = STRAIGHT
    reference_start_m: float = 0.0
    section_m: tuple[float, float] = (0.0, 640.0)
    walls_xy: ClassVar[None] = None
    graph: ClassVar[None] = None
    has_headings: ClassVar[bool] = False
    signals: ClassVar[int] = 0

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

    def shifted(self, left_m: float) -> CorridorRoad:
        """Return the road with its lanes so far to the left."""
        lanes = (replace(lane, right_m=lane.right_m + left_m, left_m=lane.left_m + left_m) for lane in self.lanes)
        return replace(self, lanes=tuple(lanes))

    def axis_of(self, heading_rad: FloatArray) -> FloatArray:
        """Return zeros: vehicles are measured along the road."""
        return np.zeros(len(heading_rad))

    def lane_heading_at(self, lon_m: FloatArray, lat_m: FloatArray) -> FloatArray:
        """Return the road's direction, (n,)."""
        return self.heading_at(lon_m)

    def to_stop_line_m(self, lon_m: FloatArray, lat_m: FloatArray, heading_rad: FloatArray) -> None:
        """Return None: no stop lines are known."""

    def on_a_lane(self, lon_m: FloatArray, lat_m: FloatArray) -> BoolArray:
        """Return whether positions are on a lane, (n,)."""
        return self.lane_index_at(lon_m, lat_m) >= 0

    def speed_limit_of(self, lane: IntArray) -> FloatArray:
        """Return nan: no limits are known."""
        return np.full(len(lane), np.nan)

    def across_m(self, lon_m: tuple[float, float], lat_m: float, half_m: float) -> tuple[float, float]:
        """Return the outermost lines of the lanes between two longitudinal positions."""
        _, right, left, start, end = self.lane_table.T
        near = (end > lon_m[0]) & (start < lon_m[1])
        return float(right[near].min()), float(left[near].max())

    def lines(self) -> Iterator[LaneLine]:
        """Yield nothing: all lanes are strips."""
        return iter(())

    def walls_near(self, x: float, y: float, within_m: float) -> FloatArray:
        """Return no wall, shape (0, 4)."""
        return np.zeros((0, 4))

    def draw_on_lanes(
        self,
        count: int,
        around: tuple[float, float],
        range_m: float,
        rng: np.random.Generator,
        in_reach: InReach | None = None,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Draw positions on the lanes within range along the road; see ``Road``."""
        _, right, left, start, end = self.lane_table.T
        start, end = np.maximum(start, around[0] - range_m), np.minimum(end, around[0] + range_m)
        area = np.maximum(end - start, 0.0) * (left - right)
        kept = np.zeros((0, 2))
        # Where next to no lane is in reach the drawing ends with fewer positions rather than never.
        for _ in range(MOST_DRAWINGS):
            if len(kept) >= count or area.sum() <= 0.0:
                break
            lane = rng.choice(len(area), size=max(16, 2 * count), p=area / area.sum())
            lon = rng.uniform(start[lane], np.maximum(start, end)[lane])
            lat = rng.uniform(right[lane], left[lane])
            drawn = np.stack([lon, lat], axis=-1)
            kept = np.concatenate([kept, drawn if in_reach is None else drawn[in_reach(lon, lat)]])
        lon, lat = kept[:count].T
        return lon, lat, np.zeros(len(lon))

    def draw_beside_lanes(
        self, per_km: float, around: tuple[float, float], rng: np.random.Generator
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Draw positions on the lanes' lines, up to 5 km to either side of a place; see ``Road``."""
        _, right, left, start, end = self.lane_table.T
        start = np.maximum(start, around[0] - LONGEST_ROAD_M)
        length = np.maximum(np.minimum(end, around[0] + LONGEST_ROAD_M) - start, 0.0)
        count = int(rng.poisson(per_km * length.sum() / 1e3))
        lane = rng.choice(len(length), size=count, p=length / length.sum()) if count else np.zeros(0, dtype=np.int64)
        lon = start[lane] + length[lane] * rng.random(count)
        return lon, np.where(rng.random(count) < 0.5, right[lane], left[lane]), np.zeros(count)

    def moved(
        self, lon_m: FloatArray, lat_m: FloatArray, axis_rad: FloatArray, way_m: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return positions so much farther along the road."""
        return lon_m + way_m, lat_m, axis_rad

    def come_round(
        self,
        lon_m: FloatArray,
        lat_m: FloatArray,
        ego: tuple[float, float],
        range_m: float,
    ) -> tuple[FloatArray, BoolArray]:
        """Return positions that come in at the other end of the range; nothing is left behind."""
        come_in = ego[0] + (lon_m - ego[0] + range_m) % (2.0 * range_m) - range_m
        return come_in, np.ones(len(lon_m), dtype=np.bool_)

    def lane_area_m2(self, range_m: float, width_m: float) -> float:
        """Return the area of a straight road of that width within range."""
        return 2.0 * range_m * width_m


def highway(lanes: int = 5, lane_width_m: float = 3.66, section_m: tuple[float, float] = (0.0, 640.0)) -> CorridorRoad:
    """Return a straight one-way road whose right edge lies at lateral position zero.

    Args:
        lanes: Number of lanes, without beginning or end.
        lane_width_m: Width of each, metres.
        section_m: Longitudinal positions, metres, at which the section that is scored starts and ends.
    """
    strips = tuple(
        Lane(number=lanes - k, right_m=k * lane_width_m, left_m=(k + 1) * lane_width_m) for k in range(lanes)
    )
    return CorridorRoad(lanes=strips, section_m=section_m)
