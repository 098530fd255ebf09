"""A road whose frame is the plane: lanes of any shape, curves, junctions and both directions of traffic."""

# ruff: noqa: ARG002  (a road of one kind needs less than roads are told)
from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from mmpf.map.lane_area import drawn_on_lanes, lanes_over, mean_lane_area_m2, pieces_within
from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.map.reference_line import STRAIGHT, OnReferenceLine
from mmpf.map.road import InReach, Lane, LaneLine
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

MOST_DRAWINGS = 100


@dataclass(frozen=True)
class LaneGraphRoad(OnReferenceLine):
    """A graph of lanes in the plane, and the walls beside them; see ``mmpf.map.road.Road``.

    Attributes:
        graph: The lanes; ``without_map()`` where none are known.
        section_m: From where to where they reach along x, metres.
        walls_xy: Walls of buildings, which hide what is behind them. A row is x and y of both ends, metres, (w, 4).
        reference_xy: The line that carries the frame; another than the x axis alone where a road's lanes are unknown.
        reference_start_m: Longitudinal position of its first point, metres.
    """

    graph: LaneGraph
    section_m: tuple[float, float] = (0.0, 640.0)
    walls_xy: FloatArray | None = None
    reference_xy: tuple[tuple[float, float], ...] = STRAIGHT
    reference_start_m: float = 0.0
    lanes: ClassVar[tuple[Lane, ...]] = ()
    has_headings: ClassVar[bool] = True

    @property
    def signals(self) -> int:
        """How many traffic signals there are."""
        return self.graph.signals

    def shifted(self, left_m: float) -> LaneGraphRoad:
        """Return the road with its lanes so far towards larger y; walls stay."""
        return replace(self, graph=replace(self.graph, xy=self.graph.xy + np.array([0.0, left_m])))

    def axis_of(self, heading_rad: FloatArray) -> FloatArray:
        """Return the headings: vehicles are measured along their own."""
        return heading_rad

    def lane_heading_at(self, lon_m: FloatArray, lat_m: FloatArray) -> FloatArray:
        """Return the direction of the nearest lane, nan where none is near, (n,)."""
        near = self.graph.lanes_near(lon_m, lat_m, most=1)
        return np.where(near.lane[:, 0] != NOWHERE, near.heading_rad[:, 0], np.nan)

    def to_stop_line_m(self, lon_m: FloatArray, lat_m: FloatArray, heading_rad: FloatArray) -> FloatArray | None:
        """Return how far ahead the next stop line is, infinite where none is, (n,); see ``Road``."""
        if self.graph.control is None:
            return None
        lane = self.graph.lane_at(lon_m, lat_m, heading_rad)
        along, _, _ = self.graph.on_lane(lane, lon_m, lat_m)
        return np.where(lane >= 0, self.graph.length_m[lane] - along + self.graph.to_stop_line_m[lane], np.inf)

    def on_a_lane(self, lon_m: FloatArray, lat_m: FloatArray) -> BoolArray:
        """Return whether positions are on a lane, (n,)."""
        return lanes_over(self.graph, lon_m, lat_m) > 0

    def speed_limit_of(self, lane: IntArray) -> FloatArray:
        """Return the speed limit, m/s, of lanes by their numbers, nan off every lane, (n,)."""
        return np.append(self.graph.speed_limit_mps, np.nan)[lane - 1]

    def across_m(self, lon_m: tuple[float, float], lat_m: float, half_m: float) -> tuple[float, float]:
        """Return what lies so far to either side of a lateral position."""
        return lat_m - half_m, lat_m + half_m

    def lines(self) -> Iterator[LaneLine]:
        """Yield the lanes; none without a map."""
        for k in range(len(self.graph) if self.graph.has_map else 0):
            yield LaneLine(self.graph.line(k), float(self.graph.width_m[k]), bool(self.graph.in_junction[k]))

    def walls_near(self, x: float, y: float, within_m: float) -> FloatArray:
        """Return the walls that come nearer to a place than a distance, metres, shape (k, 4)."""
        if self.walls_xy is None:
            return np.zeros((0, 4))
        start, step = self.walls_xy[:, :2] - (x, y), self.walls_xy[:, 2:] - self.walls_xy[:, :2]
        share = -(start * step).sum(axis=1) / np.maximum((step * step).sum(axis=1), 1e-12)
        nearest = start + np.clip(share, 0.0, 1.0)[:, None] * step
        return np.asarray(self.walls_xy[np.hypot(nearest[:, 0], nearest[:, 1]) < within_m])

    def draw_on_lanes(
        self,
        count: int,
        around: tuple[float, float],
        range_m: float,
        rng: np.random.Generator,
        in_reach: InReach | None = None,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Draw positions on the lanes within range; see ``Road``."""
        pieces = pieces_within(self.graph, *around, range_m)
        kept = np.zeros((0, 3))
        for _ in range(MOST_DRAWINGS):
            if len(kept) >= count or not len(pieces):
                break
            x, y, heading, even = drawn_on_lanes(self.graph, pieces, max(16, 4 * count), rng)
            near = np.hypot(x - around[0], y - around[1]) <= range_m if in_reach is None else in_reach(x, y)
            kept = np.concatenate([kept, np.stack([x, y, heading], axis=-1)[even & near]])
        x, y, heading = kept[:count].T
        return x, y, heading

    def draw_beside_lanes(
        self,
        per_km: float,
        around: tuple[float, float],
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Draw positions on the lanes, all over the map; see ``Road``."""
        length_m = self.graph.segments.length_m
        count = int(rng.poisson(per_km * length_m.sum() / 1e3)) if len(length_m) else 0
        if not count:
            return np.zeros(0), np.zeros(0), np.zeros(0)
        x, y, heading, _ = drawn_on_lanes(self.graph, np.arange(len(length_m)), count, rng)
        return x, y, heading

    def moved(
        self, lon_m: FloatArray, lat_m: FloatArray, axis_rad: FloatArray, way_m: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return where those come that go so far along the lanes that lead their way, and straight on off these."""
        lane = self.graph.lane_at(lon_m, lat_m, axis_rad)
        along, left, _ = self.graph.on_lane(lane, lon_m, lat_m)
        x, y, heading = self.graph.place(lane, along + way_m, left)
        goes = (lane != NOWHERE) & (way_m > 0.0)
        return (
            np.where(goes, x, lon_m + way_m * np.cos(axis_rad)),
            np.where(goes, y, lat_m + way_m * np.sin(axis_rad)),
            np.where(goes, heading, axis_rad),
        )

    def come_round(
        self, lon_m: FloatArray, lat_m: FloatArray, ego: tuple[float, float], range_m: float
    ) -> tuple[FloatArray, BoolArray]:
        """Return the positions as they are, and which of them are in range."""
        return lon_m, np.hypot(lon_m - ego[0], lat_m - ego[1]) <= range_m

    def lane_area_m2(self, range_m: float, width_m: float) -> float:
        """Return how much of the lanes' ground is in range on the average over the map; all ground without a map."""
        return mean_lane_area_m2(self.graph, range_m) if self.graph.has_map else np.pi * range_m**2
