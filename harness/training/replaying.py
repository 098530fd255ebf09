"""Windows turned back into what a motion model expects: states and surroundings, for any number of particles each."""

from __future__ import annotations

import numpy as np

from harness.training.following import Following
from mmpf.motion.protocol import Neighbour, Surroundings
from mmpf.road import FloatArray
from mmpf.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED, STATE_SIZE


def states_at(windows: Following, step: int) -> FloatArray:
    """Return the true states at a step, shape (6, windows): lateral from the lane's middle, its acceleration zero."""
    state = np.empty((STATE_SIZE, len(windows)))
    state[LON], state[LAT] = windows.lon_m[:, step], windows.offset_m[:, step]
    state[SPEED], state[LAT_SPEED] = windows.speed_mps[:, step], windows.lat_speed_mps[:, step]
    state[ACCEL], state[LAT_ACCEL] = windows.accel_mps2[:, step], 0.0
    return state


def surroundings_at(windows: Following, state: FloatArray, step: int, hidden: bool = False) -> Surroundings:
    """Return what particles know behind the true leaders of a step.

    Args:
        windows: The windows, m of them.
        state: Particle states, shape (6, m * p), the p particles of each window side by side.
        step: Step whose leaders are taken.
        hidden: Whether the vehicles count as unseen.
    """
    particles = state.shape[1] // len(windows)

    def each(values: FloatArray) -> FloatArray:
        return np.repeat(values, particles)

    count = state.shape[1]
    exists = np.repeat(windows.has_leader, particles)
    own_length, leader_length = each(windows.length_m), each(windows.leader_length_m)
    gap = each(windows.leader_lon_m[:, step]) - state[LON] - 0.5 * (own_length + leader_length)
    leader = Neighbour(
        exists=exists,
        gap_m=np.where(exists, gap, np.inf),
        speed_mps=np.where(exists, each(windows.leader_speed_mps[:, step]), state[SPEED]),
        accel_mps2=np.where(exists, each(windows.leader_accel_mps2[:, step]), 0.0),
        length_m=np.where(exists, leader_length, own_length),
    )
    nobody = Neighbour(
        np.zeros(count, dtype=np.bool_), np.full(count, np.inf), state[SPEED], np.zeros(count), own_length
    )
    half_width = 0.5 * each(windows.lane_width_m)
    none = np.zeros(count, dtype=np.bool_)
    return Surroundings(
        length_m=own_length,
        lane_right_m=-half_width,
        lane_left_m=half_width,
        has_left_lane=none,
        has_right_lane=none,
        leader=leader,
        left_leader=nobody,
        left_follower=nobody,
        right_leader=nobody,
        right_follower=nobody,
        flow_speed_mps=np.full(count, np.nan),
        is_hidden=np.full(count, hidden),
    )
