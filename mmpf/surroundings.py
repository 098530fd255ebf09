"""Road and traffic around each particle, taken from the lanes, the other components and the ego vehicle.

Who leads and who follows whom is settled between component means, lane by lane; the gap is then each particle's own.
"""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from mmpf.motion.protocol import Neighbour, Surroundings
from mmpf.options import Footprint
from mmpf.road import FloatArray, IntArray, Road
from mmpf.scan import EgoPose
from mmpf.state import ACCEL, LAT, LON, SPEED

OFF_ROAD = -1
NOBODY = -1
FLOW_LENGTH_M = 25.0
FLOW_OTHER_LANE_WEIGHT = 0.15


def surroundings_of(
    state: FloatArray,
    component: IntArray,
    mean: FloatArray,
    is_neighbour: npt.NDArray[np.bool_],
    is_seen: npt.NDArray[np.bool_],
    ego: EgoPose,
    ego_accel_mps2: float,
    road: Road,
    vehicle: Footprint,
) -> Surroundings:
    """Return what each particle knows of road and traffic.

    Args:
        state: Particles' states, shape (6, n).
        component: Each particle's component, shape (n,).
        mean: Components' mean states, shape (6, m).
        is_neighbour: Components that count as vehicles for the others, shape (m,).
        is_seen: Components that were seen lately, shape (m,).
        ego: Pose of the sensor's own vehicle, a neighbour like any other.
        ego_accel_mps2: Its longitudinal acceleration.
        road: The lanes.
        vehicle: Nominal size of a vehicle.
    """
    others = np.column_stack([mean, [ego.lon_m, ego.lat_m, ego.speed_mps, 0.0, ego_accel_mps2, 0.0]])
    counts = np.append(is_neighbour, True)
    length = np.append(np.full(mean.shape[1], vehicle.length_m), ego.length_m)
    lane_of_other = road.lane_index_at(others[LON], others[LAT])
    leader, follower = _neighbours_by_lane(others[LON], lane_of_other, counts, len(road.lanes))

    lane = nearest_lane(road, state[LON], state[LAT])
    left, right = adjacent_lanes(road)
    table = road.lane_table
    lanes = np.stack([lane, left[lane], right[lane]])
    lanes[1:] = np.where(_lane_is_there(table, lanes[1:], state[LON]), lanes[1:], OFF_ROAD)

    def neighbour(chosen: IntArray, target: IntArray, ahead: bool) -> Neighbour:
        found = np.where(target >= 0, chosen[component, target], NOBODY)
        return _neighbour(state, found, others, length, vehicle.length_m, ahead)

    flow = flow_speeds(others[:, :-1], lane_of_other[:-1], is_neighbour & is_seen)
    return Surroundings(
        length_m=np.full(len(component), vehicle.length_m),
        lane_right_m=table[lane, 1],
        lane_left_m=table[lane, 2],
        has_left_lane=lanes[1] >= 0,
        has_right_lane=lanes[2] >= 0,
        leader=neighbour(leader, lanes[0], True),
        left_leader=neighbour(leader, lanes[1], True),
        left_follower=neighbour(follower, lanes[1], False),
        right_leader=neighbour(leader, lanes[2], True),
        right_follower=neighbour(follower, lanes[2], False),
        flow_speed_mps=flow[component],
        is_hidden=~is_seen[component],
    )


def nearest_lane(road: Road, lon_m: FloatArray, lat_m: FloatArray) -> IntArray:
    """Return the index of the lane that each position is in or, off the road, nearest to, shape (n,)."""
    table = road.lane_table
    lane = np.empty(len(lon_m), dtype=np.int64)
    _nearest_lane(table[:, 1], table[:, 2], table[:, 3], table[:, 4], lon_m, lat_m, lane)
    return lane


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


def _lane_is_there(table: FloatArray, lane: IntArray, lon_m: FloatArray) -> npt.NDArray[np.bool_]:
    return np.asarray((lane >= 0) & (lon_m >= table[lane, 3]) & (lon_m < table[lane, 4]))


def _neighbour(
    state: FloatArray,
    found: IntArray,
    others: FloatArray,
    length: FloatArray,
    own_length_m: float,
    ahead: bool,
) -> Neighbour:
    exists = found >= 0
    distance = others[LON][found] - state[LON]
    gap = (distance if ahead else -distance) - 0.5 * (own_length_m + length[found])
    return Neighbour(
        exists=exists,
        gap_m=np.where(exists, gap, np.inf),
        speed_mps=np.where(exists, others[SPEED][found], state[SPEED]),
        accel_mps2=np.where(exists, others[ACCEL][found], 0.0),
        length_m=np.where(exists, length[found], own_length_m),
    )


@numba.njit(cache=True)
def _neighbours_by_lane(
    lon: FloatArray, lane: IntArray, counts: npt.NDArray[np.bool_], lanes: int
) -> tuple[IntArray, IntArray]:
    """Return the nearest counted vehicle ahead of and behind each one in every lane, each of shape (m, lanes)."""
    leader = np.full((len(lon), lanes), NOBODY, dtype=np.int64)
    follower = np.full((len(lon), lanes), NOBODY, dtype=np.int64)
    for m in range(len(lon)):
        for other in range(len(lon)):
            if other == m or not counts[other] or lane[other] < 0:
                continue
            strip = lane[other]
            if lon[other] > lon[m]:
                nearest = leader[m, strip]
                if nearest < 0 or lon[other] < lon[nearest]:
                    leader[m, strip] = other
            else:
                nearest = follower[m, strip]
                if nearest < 0 or lon[other] > lon[nearest]:
                    follower[m, strip] = other
    return leader, follower


@numba.njit(cache=True)
def _nearest_lane(
    right: FloatArray,
    left: FloatArray,
    start: FloatArray,
    end: FloatArray,
    lon: FloatArray,
    lat: FloatArray,
    lane: IntArray,
) -> None:
    for n in range(len(lon)):
        smallest = np.inf
        lane[n] = 0
        for k in range(len(right)):
            if lon[n] < start[k] or lon[n] >= end[k]:
                continue
            distance = abs(lat[n] - 0.5 * (right[k] + left[k])) - 0.5 * (left[k] - right[k])
            if distance < smallest:
                smallest = distance
                lane[n] = k
