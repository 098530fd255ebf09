"""Car following and safe gaps: the intelligent driver model applied to beliefs.

The parameters are the highway column of Treiber and Kesting, "Traffic Flow Dynamics" (2013), table 11.2.
"""

import numpy as np

from harness.decisions.belief import Belief, Beside, Others
from mmpf.motion.idm import SMALLEST_GAP_M, TREIBER_KESTING_2013, IdmParameters
from mmpf.motion.kinematic import HARDEST_BRAKING_MPS2
from mmpf.numerics.arrays import BoolArray, FloatArray

PARAMETERS = TREIBER_KESTING_2013
SAFE_DECEL_MPS2 = 4.0
"""Braking that a gap may ask of the ego and of the vehicle behind it (Kesting, Treiber and Helbing 2007)."""


def free_acceleration(belief: Belief, speed_mps: FloatArray) -> FloatArray:
    """Return the acceleration on a free road, up to its limit where there is one, shape (n,)."""
    limit = belief.speed_limit_mps
    desired = np.where(np.isfinite(limit), limit, PARAMETERS.desired_speed_mps)
    return np.asarray(PARAMETERS.max_accel_mps2 * (1.0 - (speed_mps / desired) ** PARAMETERS.exponent))


def interaction(speed_mps: FloatArray, other: Others, parameters: IdmParameters = PARAMETERS) -> FloatArray:
    """Return the braking, positive, caused by one vehicle ahead; 0 where there is none, shape (n,)."""
    scale = 2.0 * np.sqrt(parameters.max_accel_mps2 * parameters.comfortable_decel_mps2)
    closing = speed_mps * (speed_mps - other.speed_mps) / scale
    wanted = parameters.standstill_gap_m + np.maximum(speed_mps * parameters.time_headway_s + closing, 0.0)
    gap = np.maximum(other.gap_m, SMALLEST_GAP_M)
    return np.asarray(parameters.max_accel_mps2 * (wanted / gap) ** 2)


def following(belief: Belief, leader: Others) -> FloatArray:
    """Return the ego's acceleration behind a vehicle, no harder than a car can brake, shape (n,)."""
    free = free_acceleration(belief, belief.speed_mps)
    return np.maximum(free - interaction(belief.speed_mps, leader), -HARDEST_BRAKING_MPS2)


def follower_acceleration(belief: Belief, follower: Others, ahead: Others | None) -> FloatArray:
    """Return the acceleration of a follower: the ego if ``ahead`` is None, else that vehicle, shape (n,)."""
    before = Others(follower.gap_m, belief.speed_mps, follower.body) if ahead is None else ahead
    free = free_acceleration(belief, follower.speed_mps)
    return np.maximum(free - interaction(follower.speed_mps, before), -HARDEST_BRAKING_MPS2)


def safe_gap(belief: Belief, side: Beside) -> BoolArray:
    """Return whether neither the ego nor the vehicle behind would have to brake hard after a change of lanes, (n,)."""
    own = following(belief, side.leader) >= -SAFE_DECEL_MPS2
    behind = ~side.follower.exists | (follower_acceleration(belief, side.follower, None) >= -SAFE_DECEL_MPS2)
    return np.asarray(side.exists & own & behind & (side.leader.gap_m > 0.0) & (side.follower.gap_m > 0.0))
