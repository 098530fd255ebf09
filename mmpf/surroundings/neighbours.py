"""The vehicles ahead of and behind each vehicle in every lane, and each particle's distances to them."""

from dataclasses import dataclass
from functools import cached_property
from operator import attrgetter

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


@dataclass(frozen=True)
class KnownTraffic:
    """What distances to neighbours are measured from.

    Attributes:
        state: Particles' states, shape (6, n).
        component: Row of each particle's component in ``nearest`` and ``length_m``, shape (n,).
        others: Rows of position, speed and acceleration of all vehicles, shape (3, m + 1).
        length_m: Their lengths, once for each case of who counts, shape (cases * (m + 1),).
    """

    state: FloatArray
    component: IntArray
    others: FloatArray
    length_m: FloatArray

    def measured(self, lane: Int32Array, nearest: IntArray, sign: float, index: IntArray | None = None) -> Neighbour:
        """Return the neighbours in one direction.

        Args:
            lane: Lane in which each particle looks, ``OFF_ROAD`` for none, shape (n,).
            nearest: Nearest vehicle for each case, component and lane, shape (cases * (m + 1), lanes).
            sign: 1 if it is ahead, -1 if it is behind.
            index: Particles that are asked for; None for all.
        """
        asked = np.arange(len(lane)) if index is None else index
        n = len(asked)
        lon, speed, found = self.state[LON], self.state[SPEED], to_be_found(n)

        def measure(begin: int, end: int) -> None:
            which = begin, end, asked, lon, speed, self.component
            _measure_neighbours(*which, lane, nearest, sign, self.others, self.length_m, found)

        in_shares(measure, n, cost=0.5)
        return found


@dataclass(frozen=True)
class UnmeasuredNeighbour:
    """Neighbours in a lane beside: few particles ask for them, so they are measured for those, or when asked for.

    Attributes:
        known: What they are measured from; the others are arguments of ``KnownTraffic.measured``.
    """

    known: KnownTraffic
    lane: Int32Array
    nearest: IntArray
    sign: float

    def take(self, index: IntArray) -> Neighbour:
        """Measure the neighbours of some of the particles."""
        return self.known.measured(self.lane, self.nearest, self.sign, index)

    @cached_property
    def _all(self) -> Neighbour:
        return self.known.measured(self.lane, self.nearest, self.sign)

    exists = property(attrgetter("_all.exists"))
    gap_m = property(attrgetter("_all.gap_m"))
    speed_mps = property(attrgetter("_all.speed_mps"))
    accel_mps2 = property(attrgetter("_all.accel_mps2"))
    length_m = property(attrgetter("_all.length_m"))


@kernel()
def _measure_neighbours(
    begin: int,
    end: int,
    index: IntArray,
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
    for k in range(begin, end):
        n = index[k]
        own_length = length[component[n]]
        found = nearest[component[n], lane[n]] if lane[n] >= 0 else NOBODY
        if found >= 0:
            exists[k] = True
            gap[k] = sign * (others[0, found] - lon[n]) - 0.5 * (own_length + length[found])
            neighbour_speed[k] = others[1, found]
            neighbour_accel[k] = others[2, found]
            neighbour_length[k] = length[found]
        else:
            exists[k] = False
            gap[k] = np.inf
            neighbour_speed[k] = speed[n]
            neighbour_accel[k] = 0.0
            neighbour_length[k] = own_length
