"""Car following and safe gaps: the intelligent driver model applied to beliefs.

The parameters are the highway column of Treiber and Kesting, "Traffic Flow Dynamics" (2013), table 11.2.
"""

from __future__ import annotations

import numpy as np

from harness.decisions.belief import Belief, Beside, Others
from mmpf.motion.idm import SMALLEST_GAP_M, TREIBER_KESTING_2013, IdmParameters
from mmpf.motion.kinematic import HARDEST_BRAKING_MPS2
from mmpf.numerics.arrays import BoolArray, FloatArray

PARAMETERS = TREIBER_KESTING_2013
SAFE_DECEL_MPS2 = 4.0
"""Braking that a gap may ask of the ego and of the vehicle behind it (Kesting, Treiber and Helbing 2007)."""


def desired_speeds(belief: Belief, parameters: IdmParameters = PARAMETERS) -> FloatArray:
    """Return the speed that the driver wants at each step: the limit where there is one, shape (n,)."""
    limit = belief.speed_limit_mps
    return np.where(np.isfinite(limit), limit, parameters.desired_speed_mps)


def free_acceleration(speed_mps: FloatArray, desired_mps: FloatArray, parameters: IdmParameters) -> FloatArray:
    """Return the acceleration on a free road, shape (n,)."""
    return np.asarray(parameters.max_accel_mps2 * (1.0 - (speed_mps / desired_mps) ** parameters.exponent))


def interaction(speed_mps: FloatArray, other: Others, parameters: IdmParameters) -> FloatArray:
    """Return the braking, positive, caused by one vehicle ahead; 0 where there is none, shape (n,)."""
    scale = 2.0 * np.sqrt(parameters.max_accel_mps2 * parameters.comfortable_decel_mps2)
    closing = speed_mps * (speed_mps - other.speed_mps) / scale
    wanted = parameters.standstill_gap_m + np.maximum(speed_mps * parameters.time_headway_s + closing, 0.0)
    gap = np.maximum(other.gap_m, SMALLEST_GAP_M)
    return np.asarray(parameters.max_accel_mps2 * (wanted / gap) ** 2)


def following(belief: Belief, leader: Others, parameters: IdmParameters = PARAMETERS) -> FloatArray:
    """Return the ego's acceleration behind a vehicle, no harder than a car can brake, shape (n,)."""
    free = free_acceleration(belief.speed_mps, desired_speeds(belief, parameters), parameters)
    return np.maximum(free - interaction(belief.speed_mps, leader, parameters), -HARDEST_BRAKING_MPS2)


def follower_acceleration(belief: Belief, follower: Others, ahead: Others | None) -> FloatArray:
    """Return the acceleration of a follower: the ego if ``ahead`` is None, else that vehicle, shape (n,)."""
    before = Others(follower.gap_m, belief.speed_mps, follower.body) if ahead is None else ahead
    free = free_acceleration(follower.speed_mps, desired_speeds(belief), PARAMETERS)
    return np.maximum(free - interaction(follower.speed_mps, before, PARAMETERS), -HARDEST_BRAKING_MPS2)


def safe_gap(belief: Belief, side: Beside) -> BoolArray:
    """Return whether neither the ego nor the vehicle behind would have to brake hard after a change of lanes, (n,)."""
    own = following(belief, side.leader) >= -SAFE_DECEL_MPS2
    behind = ~side.follower.exists | (follower_acceleration(belief, side.follower, None) >= -SAFE_DECEL_MPS2)
    return np.asarray(side.exists & own & behind & (side.leader.gap_m > 0.0) & (side.follower.gap_m > 0.0))
