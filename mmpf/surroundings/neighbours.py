"""The vehicles ahead of and behind each vehicle in every lane, and each particle's distances to them."""

from __future__ import annotations

import numpy as np

from mmpf.motion.protocol import Neighbour
from mmpf.motion.state import LON, SPEED
from mmpf.numerics.arrays import BoolArray, FloatArray, Int32Array, IntArray
from mmpf.numerics.kernels import kernel
from mmpf.numerics.threads import in_shares

NOBODY = -1
# Bodies that overlap across the road by less than the rest of this share pass each other.
IN_THE_WAY = 0.85


@kernel()
def nearest_by_lane(
    lon: FloatArray,
    lat: FloatArray,
    width: FloatArray,
    lane: IntArray,
    counts: BoolArray,
    lanes: int,
) -> tuple[IntArray, IntArray]:
    """Return the nearest counted vehicle ahead of and behind each one in every lane, each of shape (m, lanes).

    In its own lane a vehicle minds whoever is in its way, wherever the line runs: two can pass each other on either
    side of a line, and one that straddles it can block both lanes.

    Args:
        lon: Longitudinal positions, metres, shape (m,).
        lat: Lateral positions, metres, shape (m,).
        width: Widths, metres, shape (m,).
        lane: Indices of their lanes, negative off the road, shape (m,).
        counts: Which of them count as vehicles for the others, shape (m,).
        lanes: Number of lanes.
    """
    leader = np.empty((len(lon), lanes), dtype=np.int64)
    follower = np.empty((len(lon), lanes), dtype=np.int64)
    for m in range(len(lon)):
        for strip in range(lanes):
            leader[m, strip] = follower[m, strip] = NOBODY
        for other in range(len(lon)):
            if other == m or not counts[other] or lane[other] < 0:
                continue
            strip = lane[other]
            if lane[m] >= 0:
                is_in_the_way = abs(lat[other] - lat[m]) < IN_THE_WAY * 0.5 * (width[m] + width[other])
                if is_in_the_way:
                    strip = lane[m]
                elif strip == lane[m]:
                    continue
            if lon[other] > lon[m]:
                nearest = leader[m, strip]
                if nearest < 0 or lon[other] < lon[nearest]:
                    leader[m, strip] = other
            else:
                nearest = follower[m, strip]
                if nearest < 0 or lon[other] > lon[nearest]:
                    follower[m, strip] = other
    return leader, follower


def to_be_found(n: int) -> Neighbour:
    """Return neighbours of n particles, to be written."""
    return Neighbour(np.empty(n, dtype=np.bool_), np.empty(n), np.empty(n), np.empty(n), np.empty(n))


def measured_neighbours(
    state: FloatArray,
    component: IntArray,
    others: FloatArray,
    length_m: FloatArray,
    lane: Int32Array,
    nearest: IntArray,
    sign: float,
) -> Neighbour:
    """Return each particle's neighbours in one direction.

    Args:
        state: Particles' states, shape (6, n).
        component: Row of each particle's component in ``nearest`` and ``length_m``, shape (n,).
        others: Rows of position, speed and acceleration of all vehicles, shape (3, m + 1).
        length_m: Their lengths, once for each case of who counts, shape (cases * (m + 1),).
        lane: Lane in which each particle looks, ``OFF_ROAD`` for none, shape (n,).
        nearest: Nearest vehicle for each case, component and lane, shape (cases * (m + 1), lanes).
        sign: 1 if it is ahead, -1 if it is behind.
    """
    n = state.shape[1]
    lon, speed, found = state[LON], state[SPEED], to_be_found(n)

    def measure(begin: int, end: int) -> None:
        _measure_neighbours(begin, end, lon, speed, component, lane, nearest, sign, others, length_m, found)

    in_shares(measure, n, cost=0.5)
    return found


@kernel()
def _measure_neighbours(
    begin: int,
    end: int,
    lon: FloatArray,
    speed: FloatArray,
    component: IntArray,
    lane: Int32Array,
    nearest: IntArray,
    sign: float,
    others: FloatArray,
    length: FloatArray,
    neighbour: Neighbour,
) -> None:
    """Fill in the neighbours in one direction: ``nearest`` has one per component and lane, ``sign`` is -1 behind."""
    exists, gap, neighbour_speed, neighbour_accel, neighbour_length = neighbour
    for n in range(begin, end):
        own_length = length[component[n]]
        found = nearest[component[n], lane[n]] if lane[n] >= 0 else NOBODY
        if found >= 0:
            exists[n] = True
            gap[n] = sign * (others[0, found] - lon[n]) - 0.5 * (own_length + length[found])
            neighbour_speed[n] = others[1, found]
            neighbour_accel[n] = others[2, found]
            neighbour_length[n] = length[found]
        else:
            exists[n] = False
            gap[n] = np.inf
            neighbour_speed[n] = speed[n]
            neighbour_accel[n] = 0.0
            neighbour_length[n] = own_length
