"""Road and traffic around each particle, taken from the lanes, the other components and the ego vehicle.

Who leads and who follows whom is settled between component means, lane by lane, and in the own lane by who is in the
way; the gap is then each particle's own. Off every lane, as on a ramp, there are no lines and nobody to follow.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
import numpy.typing as npt

from mmpf.motion.protocol import Neighbour, Surroundings
from mmpf.road import FloatArray, IntArray, Road
from mmpf.scan import EgoPose
from mmpf.state import ACCEL, LAT, LON, SPEED
from mmpf.threads import in_shares

LaneArray = npt.NDArray[np.int32]

OFF_ROAD = -1
NOBODY = -1
OWN, LEFT, RIGHT = range(3)
FLOW_LENGTH_M = 25.0
FLOW_OTHER_LANE_WEIGHT = 0.15
# A vehicle this far outside of every lane still belongs to the nearest one.
SHOULDER_M = 1.0
# Bodies that overlap across the road by less than the rest of this share pass each other.
IN_THE_WAY = 0.85


def surroundings_of(
    state: FloatArray,
    component: IntArray,
    mean: FloatArray,
    length_m: FloatArray,
    width_m: FloatArray,
    is_neighbour: npt.NDArray[np.bool_],
    is_seen: npt.NDArray[np.bool_],
    ego: EgoPose,
    ego_accel_mps2: float,
    road: Road,
) -> Surroundings:
    """Return what each particle knows of road and traffic.

    Args:
        state: Particles' states, shape (6, n).
        component: Each particle's component, shape (n,).
        mean: Components' mean states, shape (6, m).
        length_m: Their vehicles' lengths, shape (m,).
        width_m: Their widths, shape (m,).
        is_neighbour: Components that count as vehicles for the others, shape (m,).
        is_seen: Components that were seen lately, shape (m,).
        ego: Pose of the sensor's own vehicle, a neighbour like any other.
        ego_accel_mps2: Its longitudinal acceleration.
        road: The lanes.
    """
    others = np.column_stack([mean, [ego.lon_m, ego.lat_m, ego.speed_mps, 0.0, ego_accel_mps2, 0.0]])
    counts = np.append(is_neighbour, True)
    length = np.append(length_m, ego.length_m)
    lane_of_other = road.lane_index_at(others[LON], others[LAT])
    leader, follower = _neighbours_by_lane(
        others[LON], others[LAT], np.append(width_m, ego.width_m), lane_of_other, counts, len(road.lanes)
    )

    n = state.shape[1]
    lane, has_lane, lane_line_m = np.empty((3, n), dtype=np.int32), np.empty((2, n), dtype=np.bool_), np.empty((2, n))
    left, right = adjacent_lanes(road)
    lanes = road.lane_table

    def find_lanes(begin: int, end: int) -> None:
        _find_lanes(begin, end, state[LON], state[LAT], lanes, left, right, lane, has_lane, lane_line_m)

    in_shares(find_lanes, n)
    known = _Known(state, component, others[[LON, SPEED, ACCEL]], length)
    flow = flow_speeds(others[:, :-1], lane_of_other[:-1], is_neighbour & is_seen)
    return Surroundings(
        length_m=length_m[component],
        lane_right_m=lane_line_m[0],
        lane_left_m=lane_line_m[1],
        has_left_lane=has_lane[0],
        has_right_lane=has_lane[1],
        leader=known.measured(lane[OWN], leader, 1.0),
        left_leader=_Unmeasured(known, lane[LEFT], leader, 1.0),
        left_follower=_Unmeasured(known, lane[LEFT], follower, -1.0),
        right_leader=_Unmeasured(known, lane[RIGHT], leader, 1.0),
        right_follower=_Unmeasured(known, lane[RIGHT], follower, -1.0),
        flow_speed_mps=flow[component],
        is_hidden=~is_seen[component],
    )


def adjacent_lanes(road: Road) -> tuple[IntArray, IntArray]:
    """Return for each lane the index of the lane to its left and to its right, ``OFF_ROAD`` if there is none."""
    table = road.lane_table
    touches = np.abs(table[:, None, 2] - table[None, :, 1]) < 0.5
    left = np.where(touches.any(axis=1), touches.argmax(axis=1), OFF_ROAD)
    right = np.where(touches.any(axis=0), touches.argmax(axis=0), OFF_ROAD)
    return left, right


def flow_speeds(mean: FloatArray, lane: IntArray, counts: npt.NDArray[np.bool_]) -> FloatArray:
    """Return the speed of the counted traffic near each component, nan where there is none, shape (m,).

    Args:
        mean: Components' mean states, shape (6, m).
        lane: Their lanes, shape (m,).
        counts: Which of them are seen vehicles, shape (m,).
    """
    weight = np.exp(-np.abs(mean[LON][:, None] - mean[LON][None, :]) / FLOW_LENGTH_M)
    weight *= np.where(lane[:, None] == lane[None, :], 1.0, FLOW_OTHER_LANE_WEIGHT)
    weight *= counts[None, :]
    np.fill_diagonal(weight, 0.0)
    total = weight.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(total > 1e-3, weight @ mean[SPEED] / total, np.nan)


@dataclass(frozen=True)
class _Known:
    """What distances to neighbours are measured from.

    Attributes:
        state: Particles' states, shape (6, n).
        component: Their components, shape (n,).
        others: Rows of position, speed and acceleration of all vehicles, shape (3, m + 1).
        length_m: Their lengths, shape (m + 1,).
    """

    state: FloatArray
    component: IntArray
    others: FloatArray
    length_m: FloatArray

    def measured(self, lane: LaneArray, nearest: IntArray, sign: float, index: IntArray | None = None) -> Neighbour:
        """Return the neighbours in one direction.

        Args:
            lane: Lane in which each particle looks, ``OFF_ROAD`` for none, shape (n,).
            nearest: Nearest vehicle for each component and lane, shape (m + 1, lanes).
            sign: 1 if it is ahead, -1 if it is behind.
            index: Particles that are asked for; None for all.
        """
        lon, speed, component = self.state[LON], self.state[SPEED], self.component
        if index is not None:
            lon, speed, component, lane = lon[index], speed[index], component[index], lane[index]
        n = len(lon)
        found = Neighbour(np.empty(n, dtype=np.bool_), *(np.empty(n) for _ in range(4)))

        def measure(begin: int, end: int) -> None:
            _measure_neighbours(
                begin,
                end,
                lon,
                speed,
                component,
                lane,
                nearest,
                sign,
                self.others,
                self.length_m,
                found.exists,
                found.gap_m,
                found.speed_mps,
                found.accel_mps2,
                found.length_m,
            )

        in_shares(measure, n, cost=0.5)
        return found


@dataclass(frozen=True)
class _Unmeasured:
    """Neighbours in a lane beside: few particles ask for them, so they are measured for those, or when asked for.

    Attributes:
        known: What they are measured from.
        lane: See ``_Known.measured``.
        nearest: See ``_Known.measured``.
        sign: See ``_Known.measured``.
    """

    known: _Known
    lane: LaneArray
    nearest: IntArray
    sign: float

    def take(self, index: IntArray) -> Neighbour:
        """Measure the neighbours of some of the particles."""
        return self.known.measured(self.lane, self.nearest, self.sign, index)

    @cached_property
    def _all(self) -> Neighbour:
        return self.known.measured(self.lane, self.nearest, self.sign)

    @property
    def exists(self) -> npt.NDArray[np.bool_]:
        """See ``Neighbour``."""
        return self._all.exists

    @property
    def gap_m(self) -> FloatArray:
        """See ``Neighbour``."""
        return self._all.gap_m

    @property
    def speed_mps(self) -> FloatArray:
        """See ``Neighbour``."""
        return self._all.speed_mps

    @property
    def accel_mps2(self) -> FloatArray:
        """See ``Neighbour``."""
        return self._all.accel_mps2

    @property
    def length_m(self) -> FloatArray:
        """See ``Neighbour``."""
        return self._all.length_m


@numba.njit(cache=True, nogil=True)
def _find_lanes(
    begin: int,
    end: int,
    lon: FloatArray,
    lat: FloatArray,
    lanes: FloatArray,
    left: IntArray,
    right: IntArray,
    lane: LaneArray,
    has_lane: npt.NDArray[np.bool_],
    lane_line: FloatArray,
) -> None:
    """Write each particle's own lane, the ones to its left and right, whether there are any, and the own lines."""
    own, own_left, own_right = lane[OWN], lane[LEFT], lane[RIGHT]
    at, beside_left, beside_right = 0, OFF_ROAD, OFF_ROAD
    right_m, left_m, start_m, end_m = np.inf, -np.inf, 0.0, 0.0
    for n in range(begin, end):
        # A particle is mostly in the lane of the one before it.
        if not (right_m < lat[n] < left_m and start_m <= lon[n] < end_m):
            at = _lane_at(lanes, lon[n], lat[n])
            if at == OFF_ROAD:
                beside_left, beside_right = OFF_ROAD, OFF_ROAD
                right_m, left_m = np.nan, np.nan
            else:
                beside_left, beside_right = left[at], right[at]
                right_m, left_m, start_m, end_m = lanes[at, 1], lanes[at, 2], lanes[at, 3], lanes[at, 4]
        own[n] = at
        own_left[n] = _lane_if_there(lanes, beside_left, lon[n])
        own_right[n] = _lane_if_there(lanes, beside_right, lon[n])
        has_lane[0, n], has_lane[1, n] = own_left[n] >= 0, own_right[n] >= 0
        lane_line[0, n], lane_line[1, n] = right_m, left_m


@numba.njit(cache=True, nogil=True)
def _measure_neighbours(
    begin: int,
    end: int,
    lon: FloatArray,
    speed: FloatArray,
    component: IntArray,
    lane: LaneArray,
    nearest: IntArray,
    sign: float,
    others: FloatArray,
    length: FloatArray,
    exists: npt.NDArray[np.bool_],
    gap: FloatArray,
    neighbour_speed: FloatArray,
    neighbour_accel: FloatArray,
    neighbour_length: FloatArray,
) -> None:
    """Fill in the neighbours in one direction: ``nearest`` has one per component and lane, ``sign`` is -1 behind."""
    for n in range(begin, end):
        found = nearest[component[n], lane[n]] if lane[n] >= 0 else NOBODY
        if found >= 0:
            exists[n] = True
            gap[n] = sign * (others[0, found] - lon[n]) - 0.5 * (length[component[n]] + length[found])
            neighbour_speed[n] = others[1, found]
            neighbour_accel[n] = others[2, found]
            neighbour_length[n] = length[found]
        else:
            exists[n] = False
            gap[n] = np.inf
            neighbour_speed[n] = speed[n]
            neighbour_accel[n] = 0.0
            neighbour_length[n] = length[component[n]]


@numba.njit(cache=True)
def _lane_if_there(lanes: FloatArray, lane: int, lon: float) -> int:
    return lane if lane >= 0 and lanes[lane, 3] <= lon < lanes[lane, 4] else OFF_ROAD


@numba.njit(cache=True)
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


@numba.njit(cache=True)
def _neighbours_by_lane(
    lon: FloatArray,
    lat: FloatArray,
    width: FloatArray,
    lane: IntArray,
    counts: npt.NDArray[np.bool_],
    lanes: int,
) -> tuple[IntArray, IntArray]:
    """Return the nearest counted vehicle ahead of and behind each one in every lane, each of shape (m, lanes).

    In its own lane a vehicle minds whoever is in its way, wherever the line runs: two can pass each other on either
    side of a line, and one that straddles it can block both lanes.
    """
    leader = np.full((len(lon), lanes), NOBODY, dtype=np.int64)
    follower = np.full((len(lon), lanes), NOBODY, dtype=np.int64)
    for m in range(len(lon)):
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
