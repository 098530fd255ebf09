"""Road and traffic around each particle, taken from the lanes, the other components and the ego vehicle.

Who leads and who follows whom is settled between component means, lane by lane, and in the own lane by who is in the
way; the gap is then each particle's own. Off every lane, as on a ramp, there are no lines and nobody to follow.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from mmpf.motion.protocol import Neighbour, Surroundings
from mmpf.road import FloatArray, IntArray, Road
from mmpf.scan import EgoPose
from mmpf.state import ACCEL, LAT, LON, SPEED

OFF_ROAD = -1
NOBODY = -1
LEADER, LEFT_LEADER, LEFT_FOLLOWER, RIGHT_LEADER, RIGHT_FOLLOWER = range(5)
DIRECTIONS = 5
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

    around = _Around.empty(state.shape[1])
    left, right = adjacent_lanes(road)
    _look_around(
        state[LON],
        state[LAT],
        state[SPEED],
        component,
        road.lane_table,
        left,
        right,
        leader,
        follower,
        others[[LON, SPEED, ACCEL]],
        length,
        around.lane_line_m,
        around.has_lane,
        around.exists,
        around.gap_m,
        around.speed_mps,
        around.accel_mps2,
        around.length_m,
    )
    flow = flow_speeds(others[:, :-1], lane_of_other[:-1], is_neighbour & is_seen)
    return Surroundings(
        length_m=length_m[component],
        lane_right_m=around.lane_line_m[0],
        lane_left_m=around.lane_line_m[1],
        has_left_lane=around.has_lane[0],
        has_right_lane=around.has_lane[1],
        leader=around.neighbour(LEADER),
        left_leader=around.neighbour(LEFT_LEADER),
        left_follower=around.neighbour(LEFT_FOLLOWER),
        right_leader=around.neighbour(RIGHT_LEADER),
        right_follower=around.neighbour(RIGHT_FOLLOWER),
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
class _Around:
    """What the kernel finds out about n particles: rows are directions, as the constants above number them.

    Attributes:
        lane_line_m: Right and left line of the own lane, shape (2, n).
        has_lane: Whether there is a lane to the left and to the right, shape (2, n).
        exists: Whether there is a neighbour, shape (5, n).
        gap_m: Clear distance to it, shape (5, n).
        speed_mps: Its speed, shape (5, n).
        accel_mps2: Its acceleration, shape (5, n).
        length_m: Its length, shape (5, n).
    """

    lane_line_m: FloatArray
    has_lane: npt.NDArray[np.bool_]
    exists: npt.NDArray[np.bool_]
    gap_m: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray
    length_m: FloatArray

    @classmethod
    def empty(cls, n: int) -> _Around:
        """Return arrays to be filled in."""
        return cls(
            np.empty((2, n)),
            np.empty((2, n), dtype=np.bool_),
            np.empty((DIRECTIONS, n), dtype=np.bool_),
            *(np.empty((DIRECTIONS, n)) for _ in range(4)),
        )

    def neighbour(self, direction: int) -> Neighbour:
        """Return the neighbour in one direction."""
        return Neighbour(
            exists=self.exists[direction],
            gap_m=self.gap_m[direction],
            speed_mps=self.speed_mps[direction],
            accel_mps2=self.accel_mps2[direction],
            length_m=self.length_m[direction],
        )


@numba.njit(cache=True)
def _look_around(
    lon: FloatArray,
    lat: FloatArray,
    speed: FloatArray,
    component: IntArray,
    lanes: FloatArray,
    left: IntArray,
    right: IntArray,
    leader: IntArray,
    follower: IntArray,
    others: FloatArray,
    length: FloatArray,
    lane_line: FloatArray,
    has_lane: npt.NDArray[np.bool_],
    exists: npt.NDArray[np.bool_],
    gap: FloatArray,
    neighbour_speed: FloatArray,
    neighbour_accel: FloatArray,
    neighbour_length: FloatArray,
) -> None:
    """Fill in each particle's lane and neighbours; ``others`` has rows of position, speed and acceleration."""
    targets = np.empty((3, len(lon)), dtype=np.int64)
    for n in range(len(lon)):
        lane = _lane_at(lanes, lon[n], lat[n])
        targets[0, n] = lane
        if lane == OFF_ROAD:
            targets[1, n], targets[2, n] = OFF_ROAD, OFF_ROAD
            lane_line[0, n], lane_line[1, n] = np.nan, np.nan
        else:
            targets[1, n] = _lane_if_there(lanes, left[lane], lon[n])
            targets[2, n] = _lane_if_there(lanes, right[lane], lon[n])
            lane_line[0, n], lane_line[1, n] = lanes[lane, 1], lanes[lane, 2]
        has_lane[0, n], has_lane[1, n] = targets[1, n] >= 0, targets[2, n] >= 0
    for direction in range(DIRECTIONS):
        is_follower = direction in (LEFT_FOLLOWER, RIGHT_FOLLOWER)
        _measure_neighbours(
            lon,
            speed,
            component,
            targets[(direction + 1) // 2],
            follower if is_follower else leader,
            -1.0 if is_follower else 1.0,
            others,
            length,
            exists[direction],
            gap[direction],
            neighbour_speed[direction],
            neighbour_accel[direction],
            neighbour_length[direction],
        )


@numba.njit(cache=True)
def _measure_neighbours(
    lon: FloatArray,
    speed: FloatArray,
    component: IntArray,
    target: IntArray,
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
    for n in range(len(lon)):
        found = nearest[component[n], target[n]] if target[n] >= 0 else NOBODY
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
