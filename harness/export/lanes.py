"""The lanes of a run's road as lines in the plane, cut to the part that was driven."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from shapely import LineString

from harness.running.finished import RecordedRun
from harness.storage.tables import floats
from mmpf.map.road import Lane, Road
from mmpf.numerics.arrays import FloatArray, IntArray

BEYOND_M = 100.0
# A bent line is drawn by as many points as keep it this close.
SPACING_M, TOLERANCE_M = 2.0, 0.02
SAME_M = 0.05
NO_STRIP = -1


@dataclass(frozen=True)
class LanePolyline:
    """A line along the road at a lateral position, from begin to end."""

    side_m: float
    start_m: float
    end_m: float

    def points(self, road: Road) -> FloatArray:
        """Return the line in the plane, shape (n, 2), as few points as keep it within two centimetres."""
        count = 2 if road.is_straight else max(2, round((self.end_m - self.start_m) / SPACING_M) + 1)
        lon = np.linspace(self.start_m, self.end_m, count)
        x, y = road.to_cartesian(lon, np.full_like(lon, self.side_m))
        line = LineString(np.column_stack([x, y])).simplify(TOLERANCE_M)
        return np.asarray(line.coords, dtype=np.float64)


@dataclass(frozen=True)
class LaneStrip:
    """A lane between two of the lines and the strips that lie against it on either side, by number."""

    lane: Lane
    left: int
    right: int
    left_neighbours: tuple[int, ...]
    right_neighbours: tuple[int, ...]


@dataclass(frozen=True)
class DrivenLanes:
    """The lanes of a stretch of road from left to right, and every line once, however many lanes it bounds."""

    lines: tuple[LanePolyline, ...]
    strips: tuple[LaneStrip, ...]
    road: Road

    def strip_at(self, lon_m: FloatArray, lat_m: FloatArray) -> IntArray:
        """Return the number of the strip at each position, shape (n,); -1 beside all of them."""
        found = np.full(len(lon_m), NO_STRIP, dtype=np.int64)
        for number, strip in enumerate(self.strips):
            lane = strip.lane
            inside = (lon_m >= lane.start_m) & (lon_m <= lane.end_m) & (lat_m >= lane.right_m) & (lat_m < lane.left_m)
            found[inside] = number
        return found


def lanes_of(run: RecordedRun) -> DrivenLanes:
    """Return the lanes of a run's road where vehicles drove, and 100 m more."""
    lon_m = floats(run.truth, "lon_m")
    first_m, last_m = (float(lon_m.min()) - BEYOND_M, float(lon_m.max()) + BEYOND_M) if len(lon_m) else (0.0, BEYOND_M)
    lanes = [
        Lane(lane.number, lane.right_m, lane.left_m, max(lane.start_m, first_m), min(lane.end_m, last_m))
        for lane in sorted(run.road.lanes, key=lambda lane: (-lane.left_m, lane.start_m))
    ]
    lanes = [lane for lane in lanes if lane.end_m - lane.start_m > SAME_M]
    numbers: dict[LanePolyline, int] = {}
    sides = [
        tuple(
            numbers.setdefault(LanePolyline(round(side, 3), round(lane.start_m, 3), round(lane.end_m, 3)), len(numbers))
            for side in (lane.left_m, lane.right_m)
        )
        for lane in lanes
    ]
    strips = [
        LaneStrip(lane, left, right, _beside(lane, lanes, is_left=True), _beside(lane, lanes, is_left=False))
        for lane, (left, right) in zip(lanes, sides, strict=True)
    ]
    return DrivenLanes(tuple(numbers), tuple(strips), run.road)


def _beside(lane: Lane, lanes: Sequence[Lane], *, is_left: bool) -> tuple[int, ...]:
    return tuple(
        number
        for number, other in enumerate(lanes)
        if abs(other.right_m - lane.left_m if is_left else other.left_m - lane.right_m) <= SAME_M
        and min(other.end_m, lane.end_m) - max(other.start_m, lane.start_m) > SAME_M
    )
