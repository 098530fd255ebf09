"""Surroundings for tests: one lane of 4 m, with or without a leader."""

from dataclasses import replace

import numpy as np

from mmpf.motion.protocol import Neighbour, Surroundings
from mmpf.motion.state import LAT, SPEED, STATE_SIZE


def states(n: int, speed_mps: float = 20.0, lat_m: float = 2.0) -> np.ndarray:
    state = np.zeros((STATE_SIZE, n))
    state[SPEED], state[LAT] = speed_mps, lat_m
    return state


def vehicle(n: int, gap_m: float, speed_mps: float, accel_mps2: float = 0.0, length_m: float = 4.6) -> Neighbour:
    parts = (gap_m, speed_mps, accel_mps2, length_m)
    return Neighbour(np.ones(n, dtype=bool), *(np.full(n, part) for part in parts))


def nobody(state: np.ndarray) -> Neighbour:
    n = state.shape[1]
    return Neighbour(np.zeros(n, dtype=bool), np.full(n, np.inf), state[SPEED], np.zeros(n), np.full(n, 4.6))


def around(
    state: np.ndarray, leader: Neighbour | None = None, *, hidden: bool = False, on_road: bool = True
) -> Surroundings:
    n = state.shape[1]
    yes = np.full(n, on_road)
    right, left = (0.0, 4.0) if on_road else (np.nan, np.nan)
    return Surroundings(
        length_m=np.full(n, 4.6),
        lane_right_m=np.full(n, right),
        lane_left_m=np.full(n, left),
        has_left_lane=yes,
        has_right_lane=yes,
        leader=leader if leader is not None else nobody(state),
        left_leader=nobody(state),
        left_follower=nobody(state),
        right_leader=nobody(state),
        right_follower=nobody(state),
        is_hidden=np.full(n, hidden),
        road_speed_mps=np.full(n, np.inf),
    )


def in_lanes(state: np.ndarray, first: float = -np.inf, last: float = np.inf) -> Surroundings:
    """Return the surroundings of each particle in its own lane; lane 0 is that of ``around``."""
    right = 4.0 * np.clip(np.floor(state[LAT] / 4.0), first, last)
    return replace(around(state), lane_right_m=right, lane_left_m=right + 4.0)
