"""The lane of each particle, its boundaries, and the adjacent lanes."""

from typing import NamedTuple

import numpy as np

from mmpf.map.corridor_road import CorridorRoad
from mmpf.numerics.arrays import BoolArray, FloatArray, Int32Array, IntArray
from mmpf.numerics.kernels import kernel, part_of_kernel
from mmpf.numerics.threads import in_shares

OFF_ROAD = -1
OWN, LEFT, RIGHT = range(3)
# A vehicle this far outside of every lane still belongs to the nearest one.
SHOULDER_M = 1.0


class LanesAround(NamedTuple):
    """The lanes at each particle, struct of arrays.

    Attributes:
        lane: Indices of its own lane and of the ones to its left and right, rows ``OWN``, ``LEFT`` and ``RIGHT``,
            ``OFF_ROAD`` for none, shape (3, n).
        has_beside: Whether there is a lane to its left and to its right, shape (2, n).
        line_m: Lateral positions of its own lane's right and left line, nan off the road, shape (2, n).
    """

    lane: Int32Array
    has_beside: BoolArray
    line_m: FloatArray


def lanes_around(lon_m: FloatArray, lat_m: FloatArray, road: CorridorRoad) -> LanesAround:
    """Return the lanes at each particle; positions in metres, shape (n,)."""
    n = len(lon_m)
    around = LanesAround(np.empty((3, n), dtype=np.int32), np.empty((2, n), dtype=np.bool_), np.empty((2, n)))
    beside, lanes = _adjacent_lanes(road), road.lane_table

    def find_lanes(begin: int, end: int) -> None:
        _find_lanes(begin, end, lon_m, lat_m, lanes, beside, around)

    in_shares(find_lanes, n)
    return around


def _adjacent_lanes(road: CorridorRoad) -> tuple[IntArray, IntArray]:
    """Return for each lane the index of the lane to its left and to its right, ``OFF_ROAD`` if there is none."""
    table = road.lane_table
    touches = np.abs(table[:, None, 2] - table[None, :, 1]) < 0.5
    left = np.where(touches.any(axis=1), touches.argmax(axis=1), OFF_ROAD)
    right = np.where(touches.any(axis=0), touches.argmax(axis=0), OFF_ROAD)
    return left, right


@kernel()
def _find_lanes(
    begin: int,
    end: int,
    lon: FloatArray,
    lat: FloatArray,
    lanes: FloatArray,
    beside: tuple[IntArray, IntArray],
    around: LanesAround,
) -> None:
    """Write each particle's own lane, the ones to its left and right, whether there are any, and the own lines.

    A particle is mostly in the lane of the one before it, so lanes are looked up once for a run of particles.
    """
    (left, right), (lane, has_lane, lane_line) = beside, around
    own, own_left, own_right = lane[OWN], lane[LEFT], lane[RIGHT]
    has_left, has_right = has_lane[0], has_lane[1]
    right_line, left_line = lane_line[0], lane_line[1]
    n = begin
    while n < end:
        at, beside_left, beside_right = _lane_at(lanes, lon[n], lat[n]), OFF_ROAD, OFF_ROAD
        right_m, left_m, start_m, end_m = np.nan, np.nan, 0.0, 0.0
        if at != OFF_ROAD:
            beside_left, beside_right = left[at], right[at]
            right_m, left_m, start_m, end_m = lanes[at, 1], lanes[at, 2], lanes[at, 3], lanes[at, 4]
        left_start_m, left_end_m = _extent(lanes, beside_left)
        right_start_m, right_end_m = _extent(lanes, beside_right)
        while True:
            own[n] = at
            has_left[n] = left_start_m <= lon[n] < left_end_m
            has_right[n] = right_start_m <= lon[n] < right_end_m
            own_left[n] = beside_left if has_left[n] else OFF_ROAD
            own_right[n] = beside_right if has_right[n] else OFF_ROAD
            right_line[n], left_line[n] = right_m, left_m
            n += 1
            if n == end or not (right_m < lat[n] < left_m and start_m <= lon[n] < end_m):
                break


@part_of_kernel()
def _extent(lanes: FloatArray, lane: int) -> tuple[float, float]:
    """Return where a lane starts and ends; that of no lane holds nothing."""
    return (lanes[lane, 3], lanes[lane, 4]) if lane != OFF_ROAD else (0.0, 0.0)


@part_of_kernel()
def _lane_at(lanes: FloatArray, lon: float, lat: float) -> int:
    """Return the lane that a position is in or next to, ``OFF_ROAD`` if there is none, as on a ramp."""
    smallest = SHOULDER_M
    nearest = OFF_ROAD
    for k in range(len(lanes)):
        if lon < lanes[k, 3] or lon >= lanes[k, 4]:
            continue
        distance = abs(lat - 0.5 * (lanes[k, 1] + lanes[k, 2])) - 0.5 * (lanes[k, 2] - lanes[k, 1])
        if distance < smallest:
            smallest = distance
            nearest = k
            if distance < 0.0:
                # Inside it: lanes do not overlap.
                break
    return nearest
