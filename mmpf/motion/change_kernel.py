"""The compiled end of a lane-change step: sampled outputs become states that a vehicle can be in."""

from __future__ import annotations

from numba import njit

from mmpf.motion.kinematics import HARDEST_BRAKING_MPS2, STRONGEST_ACCEL_MPS2
from mmpf.road import FloatArray
from mmpf.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED

TRAINED_STEP_S = 0.1
FASTEST_SIDEWAYS_MPS = 2.5
HARDEST_STEERING_MPS2 = 4.0
ADVANCE_TOLERANCE_M = 0.05


@njit(cache=True, nogil=True)
def advance(
    state: FloatArray,
    direction: FloatArray,
    sampled: FloatArray,
    held_lat_speed: FloatArray,
    held_speed: FloatArray,
    dt_s: float,
    after: FloatArray,
) -> None:
    """Write the states after a step.

    Args:
        state: States before, shape (6, n).
        direction: 1 for a change to the left, -1 to the right, shape (n,).
        sampled: Lateral and longitudinal advance, lateral and longitudinal speed, lateral and longitudinal
            acceleration after ``TRAINED_STEP_S``, lateral ones towards the target lane, shape (6, n).
        held_lat_speed: Lateral speed towards the target lane that the mixture was given, shape (n,).
        held_speed: Speed that it was given, shape (n,).
        dt_s: Length of the step.
        after: States after, shape (6, n), which are written.
    """
    steps = dt_s / TRAINED_STEP_S
    steering = HARDEST_STEERING_MPS2 * TRAINED_STEP_S
    braking, speeding = -HARDEST_BRAKING_MPS2 * TRAINED_STEP_S, STRONGEST_ACCEL_MPS2 * TRAINED_STEP_S
    for n in range(len(direction)):
        side, speed, lat_speed = direction[n], state[SPEED, n], state[LAT_SPEED, n]
        next_speed = max(speed + steps * _held(sampled[3, n] - held_speed[n], braking, speeding), 0.0)
        sideways = side * lat_speed + steps * _held(sampled[2, n] - held_lat_speed[n], -steering, steering)
        next_lat_speed = side * _held(sideways, -FASTEST_SIDEWAYS_MPS, FASTEST_SIDEWAYS_MPS)
        forward = _near(steps * sampled[1, n], 0.5 * dt_s * (speed + next_speed))
        after[LON, n] = state[LON, n] + max(forward, 0.0)
        after[LAT, n] = state[LAT, n] + _near(side * steps * sampled[0, n], 0.5 * dt_s * (lat_speed + next_lat_speed))
        after[SPEED, n] = next_speed
        after[LAT_SPEED, n] = next_lat_speed
        after[ACCEL, n] = _held(sampled[5, n], -HARDEST_BRAKING_MPS2, STRONGEST_ACCEL_MPS2)
        after[LAT_ACCEL, n] = side * _held(sampled[4, n], -HARDEST_STEERING_MPS2, HARDEST_STEERING_MPS2)


@njit(cache=True, nogil=True)
def _held(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)


@njit(cache=True, nogil=True)
def _near(advance_m: float, by_speeds_m: float) -> float:
    """Return the sampled advance, held to 5 cm of the one that follows from the speeds."""
    return _held(advance_m, by_speeds_m - ADVANCE_TOLERANCE_M, by_speeds_m + ADVANCE_TOLERANCE_M)
