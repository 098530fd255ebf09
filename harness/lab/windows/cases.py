"""The cases of a study: true trajectories, and what models may know of the traffic around them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import numpy.typing as npt

from harness.lab.windows.car_following import CarFollowing
from harness.lab.windows.changing import LaneChanges
from harness.lab.windows.neighbours import NeighbourStates
from mmpf.motion.protocol import Neighbour, Surroundings
from mmpf.motion.state import ACCEL, LAT, LAT_SPEED, LON, SPEED, STATE_SIZE
from mmpf.numerics.arrays import FloatArray, IntArray, taken

LookAround = Callable[[FloatArray, int, bool], Surroundings]


@dataclass(frozen=True)
class Cases:
    """True trajectories of m vehicles over the same number of steps.

    Attributes:
        truth: States as in ``mmpf.motion.state``, shape (steps, 6, m).
        surroundings: Given particle states of shape (6, m * p), a step and whether the vehicles count as unseen,
            returns what the particles know. It takes traffic from truth: the studies test the models alone.
        traffic: A number that vehicles of the same recording share, shape (m,).
    """

    truth: FloatArray
    surroundings: LookAround
    traffic: IntArray

    @property
    def steps(self) -> int:
        """Number of states of each trajectory."""
        return len(self.truth)

    @property
    def count(self) -> int:
        """Number of vehicles."""
        return int(self.truth.shape[2])


def following_cases(windows: CarFollowing, count: int, rng: np.random.Generator, led_only: bool = True) -> Cases:
    """Choose so many windows, or fewer, at most one of each vehicle; by ``led_only`` none without a leader."""
    order = rng.permutation(np.flatnonzero(windows.has_leader | (not led_only)))
    _, first = np.unique(windows.vehicle[order], return_index=True)
    return cases_of(taken(windows, order[np.sort(first)[:count]]))


def cases_of(windows: CarFollowing) -> Cases:
    """Return every window as a case, lateral from the middle of the lane."""
    truth = np.zeros((windows.lon_m.shape[1], STATE_SIZE, len(windows)))
    truth[:, LON], truth[:, LAT] = windows.lon_m.T, windows.offset_m.T
    truth[:, SPEED], truth[:, LAT_SPEED] = windows.speed_mps.T, windows.lat_speed_mps.T
    truth[:, ACCEL] = windows.accel_mps2.T
    return Cases(truth, partial(_behind_leaders, windows), windows.traffic)


def lane_change_cases(changes: LaneChanges, count: int, rng: np.random.Generator) -> Cases:
    """Choose windows around lane changes; lateral positions count from the original lane, positive to the target."""
    chosen = taken(changes, np.sort(rng.permutation(len(changes))[:count]))
    return Cases(
        np.ascontiguousarray(chosen.state.transpose(2, 0, 1)), partial(_around_a_change, chosen), chosen.traffic
    )


def _around_a_change(changes: LaneChanges, state: FloatArray, step: int, hidden: bool) -> Surroundings:
    """Return what particles know, each by the lane that it is in itself."""
    particles = state.shape[1] // len(changes)
    width, own_length = np.repeat(changes.lane_width_m, particles), np.repeat(changes.length_m, particles)
    crossed = state[LAT] > 0.5 * width
    leader = _neighbour(changes.leader, state, step, own_length, 1.0)
    follower = _neighbour(changes.follower, state, step, own_length, -1.0)
    target_leader = _neighbour(changes.target_leader, state, step, own_length, 1.0)
    nobody = _nobody(state, own_length)
    centre = np.where(crossed, width, 0.0)
    return replace(
        _alone(state, own_length, centre - 0.5 * width, centre + 0.5 * width, hidden),
        has_left_lane=~crossed,
        has_right_lane=crossed,
        leader=_where(crossed, target_leader, leader),
        left_leader=_where(crossed, nobody, target_leader),
        left_follower=_where(crossed, nobody, follower),
        right_leader=_where(crossed, leader, nobody),
    )


def _behind_leaders(windows: CarFollowing, state: FloatArray, step: int, hidden: bool) -> Surroundings:
    """Return what particles know behind the true leaders of a step, the particles of each window side by side."""
    particles = state.shape[1] // len(windows)
    own_length, half_width = np.repeat(windows.length_m, particles), 0.5 * np.repeat(windows.lane_width_m, particles)
    leader = _neighbour(windows.leader, state, step, own_length, 1.0)
    return replace(_alone(state, own_length, -half_width, half_width, hidden), leader=leader)


def _alone(
    state: FloatArray, own_length: FloatArray, right_m: FloatArray, left_m: FloatArray, hidden: bool
) -> Surroundings:
    """Return what particles know on a road of one lane, of which its lines are given, without anybody else."""
    nobody, no_lane = _nobody(state, own_length), np.zeros(state.shape[1], dtype=np.bool_)
    neighbours = nobody, nobody, nobody, nobody, nobody
    is_hidden, road_speed_mps = np.full(len(no_lane), hidden), np.full(len(no_lane), np.inf)
    return Surroundings(own_length, right_m, left_m, no_lane, no_lane, *neighbours, is_hidden, road_speed_mps)


def _neighbour(
    others: NeighbourStates, state: FloatArray, step: int, own_length: FloatArray, ahead: float
) -> Neighbour:
    particles = state.shape[1] // len(others.lon_m)
    lon, speed, accel, length = (
        np.repeat(column[:, step], particles)
        for column in (others.lon_m, others.speed_mps, others.accel_mps2, others.length_m)
    )
    exists = np.isfinite(lon)
    gap = ahead * (lon - state[LON]) - 0.5 * (own_length + length)
    return _where(exists, Neighbour(exists, gap, speed, accel, length), _nobody(state, own_length))


def _nobody(state: FloatArray, own_length: FloatArray) -> Neighbour:
    count = state.shape[1]
    return Neighbour(np.zeros(count, dtype=np.bool_), np.full(count, np.inf), state[SPEED], np.zeros(count), own_length)


def _where(condition: npt.NDArray[np.bool_], yes: Neighbour, no: Neighbour) -> Neighbour:
    return Neighbour(*(np.where(condition, *either) for either in zip(yes, no, strict=True)))
