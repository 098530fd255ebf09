"""The inputs of the learned driver's mixtures, the same in training and in use."""

import numpy as np

from mmpf.numerics.arrays import Float32Array, FloatArray, IntArray
from mmpf.numerics.kernels import kernel

SITUATION_SIZE = 5
SMALLEST_GAP_M = 0.3
FURTHEST_LEADER_M = 100.0
STANDSTILL_GAP_M = 2.0
SLOWEST_HEADWAY_SPEED_MPS = 3.0


def situation(
    gap_m: FloatArray,
    speed_mps: FloatArray,
    accel_mps2: FloatArray,
    leader_speed_mps: FloatArray,
    leader_accel_mps2: FloatArray,
) -> FloatArray:
    """Return a follower's view, (n, 5): log gap, own speed and acceleration, closing speed, leader's acceleration.

    Args:
        gap_m: Clear distance to the leader, shape (n,); an overlap counts as a very small gap.
        speed_mps: Own speed, shape (n,).
        accel_mps2: Own acceleration, shape (n,).
        leader_speed_mps: Leader's speed, shape (n,).
        leader_accel_mps2: Leader's acceleration, shape (n,).
    """
    log_gap = np.log(np.maximum(gap_m, SMALLEST_GAP_M))
    return np.stack([log_gap, speed_mps, accel_mps2, speed_mps - leader_speed_mps, leader_accel_mps2], axis=1)


def log_headway(gap_m: FloatArray, speed_mps: FloatArray) -> FloatArray:
    """Return the logarithm of the time headway beyond the standstill gap, in the arguments' shape."""
    beyond_standstill = np.maximum(gap_m - STANDSTILL_GAP_M, SMALLEST_GAP_M)
    return np.asarray(np.log(beyond_standstill / np.maximum(speed_mps, SLOWEST_HEADWAY_SPEED_MPS)))


@kernel()
def gather_situations(
    index: IntArray,
    gap_m: FloatArray,
    speed_mps: FloatArray,
    accel_mps2: FloatArray,
    leader_speed_mps: FloatArray,
    leader_accel_mps2: FloatArray,
    drivers: FloatArray,
    seen: Float32Array,
) -> None:
    """Write what the particles ``index``, shape (k,), see, its gap yet without logarithm, and below it their drivers.

    The other arguments are those of ``situation``, of everyone, shape (n,), and of ``drivers`` r rows, shape (r, n);
    ``seen``, shape (5 + r, k), is written variable by variable. A leader that is no nearer than ``FURTHEST_LEADER_M``
    counts as one there at the particle's own speed.
    """
    for row in range(len(drivers)):
        for k in range(len(index)):
            seen[SITUATION_SIZE + row, k] = drivers[row, index[k]]
    for k in range(len(index)):
        n = index[k]
        is_near = gap_m[n] < FURTHEST_LEADER_M
        seen[0, k] = max(gap_m[n], SMALLEST_GAP_M) if is_near else FURTHEST_LEADER_M
        seen[1, k] = speed_mps[n]
        seen[2, k] = accel_mps2[n]
        seen[3, k] = speed_mps[n] - leader_speed_mps[n] if is_near else 0.0
        seen[4, k] = leader_accel_mps2[n] if is_near else 0.0
