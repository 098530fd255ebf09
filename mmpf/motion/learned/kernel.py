"""Compiled loops of the learned driver, one pass over all particles each."""

from typing import NamedTuple

import numpy as np

from mmpf.motion.kinematic import HARDEST_BRAKING_MPS2, STRONGEST_ACCEL_MPS2
from mmpf.motion.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED
from mmpf.motion.tries import CASES
from mmpf.numerics.arrays import BoolArray, Float32Array, FloatArray, IntArray
from mmpf.numerics.kernels import kernel, part_of_kernel

ARRIVED_WITHIN_M = 0.3
AVOIDED_BY_M = 1.0
BRAKING_WORTH_IT_MPS2 = 1.0
SIDE_BY_SIDE_BELOW_M = 2.0


class FreeDriving(NamedTuple):
    """How acceleration regulates the speed of vehicles without a leader in one step.

    Attributes:
        approach: Share by which acceleration approaches what is wanted.
        gain_per_s: Wanted acceleration per m/s of missing speed.
        noise_mps2: Standard deviation of the acceleration's noise.
        strongest_mps2: Greatest wanted acceleration of those whom the road limits.
    """

    approach: float
    gain_per_s: float
    noise_mps2: float
    strongest_mps2: float


class LaneHolding(NamedTuple):
    """How vehicles hold their place in the lane in one step.

    Attributes:
        attraction_per_s2: Lateral acceleration per metre away from the place.
        damping_per_s: Lateral acceleration per m/s of lateral speed.
        kick_mps: Standard deviation of the lateral speed's noise.
    """

    attraction_per_s2: float
    damping_per_s: float
    kick_mps: float


@kernel()
def switch_intentions(
    direction: FloatArray,
    target: FloatArray,
    lat: FloatArray,
    lane_right: FloatArray,
    lane_left: FloatArray,
    has_left: BoolArray,
    has_right: BoolArray,
    is_hidden: BoolArray,
    uniform: Float32Array,
    seen_probability: float,
    hidden_probability: float,
) -> None:
    """End lane changes that have arrived and begin new ones. Rewrites ``direction`` and ``target``."""
    for n in range(len(direction)):
        if direction[n] != 0.0 and direction[n] * (target[n] - lat[n]) < ARRIVED_WITHIN_M:
            direction[n] = 0.0
        probability = hidden_probability if is_hidden[n] else seen_probability
        if probability <= uniform[n] <= 1.0 - probability or direction[n] != 0.0:
            continue
        centre, width = 0.5 * (lane_right[n] + lane_left[n]), lane_left[n] - lane_right[n]
        if not np.isfinite(centre):
            continue
        if uniform[n] < probability and has_left[n]:
            direction[n], target[n] = 1.0, centre + width
        elif uniform[n] > 1.0 - probability and has_right[n]:
            direction[n], target[n] = -1.0, centre - width


@kernel()
def look_up_changes(
    aims: FloatArray,
    after: FloatArray,
    lane_right: FloatArray,
    lane_left: FloatArray,
    has_left: BoolArray,
    has_right: BoolArray,
    is_hidden: BoolArray,
    ratios: FloatArray,
    log_ratio: FloatArray,
) -> None:
    """Write log importance weights, shape (n,). A lane change that is not in ``aims``, shape (2, n), has just begun."""
    for n in range(len(log_ratio)):
        changes = after[0, n] != 0.0
        goes_on = changes & (after[0, n] == aims[0, n]) & (after[1, n] == aims[1, n])
        may_begin = (abs(lane_right[n]) < np.inf) & (abs(lane_left[n]) < np.inf) & (not is_hidden[n]) & (not goes_on)
        log_ratio[n] = ratios[CASES * (2 * may_begin + changes) + has_left[n] + has_right[n]]


@kernel()
def drive(
    begin: int,
    end: int,
    first_follower: int,
    last_follower: int,
    state: FloatArray,
    after: FloatArray,
    desired_speed: FloatArray,
    road_speed: FloatArray,
    offset: FloatArray,
    lane_right: FloatArray,
    lane_left: FloatArray,
    followers: IntArray,
    sampled: FloatArray,
    gap: FloatArray,
    leader_speed: FloatArray,
    normal: Float32Array,
    free: FreeDriving,
    holding: LaneHolding,
    dt_s: float,
) -> None:
    """Write the states after a step in the lane.

    Args:
        begin: First particle, and
        end: the one after the last that is driven.
        first_follower: Where the first of them that follows a leader stands in ``followers``, and
        last_follower: where the one after the last does.
        state: States before, shape (6, n).
        after: States after, shape (6, n), which are written.
        desired_speed: Speed that each driver desires without a leader, shape (n,).
        road_speed: Speed at which it drives where only the road limits it, infinite where it does not, shape (n,).
        offset: Each driver's place in the lane, shape (n,).
        lane_right: Right lines of the lanes, not finite off the road, shape (n,).
        lane_left: Left lines, shape (n,).
        followers: Particles that follow a leader, ascending, shape (k,).
        sampled: Their accelerations, shape (k,).
        gap: Distance to the leaders, shape (n,).
        leader_speed: Their speeds, shape (n,).
        normal: Standard normal numbers for free driving and for the lateral speed, shape (2, n).
        free: Free driving.
        holding: Holding the lane.
        dt_s: Length of the step.
    """
    # Loops run over slices from zero on: the compiler turns only those into vector instructions.
    own, moved, own_road = state[:, begin:end], after[:, begin:end], road_speed[begin:end]
    own_desired, own_normal = desired_speed[begin:end], normal[:, begin:end]
    lon, speed, accel, lat, lat_speed = own[LON], own[SPEED], own[ACCEL], own[LAT], own[LAT_SPEED]
    for n in range(end - begin):
        wanted_speed = min(own_desired[n], own_road[n])
        # Who drove by the road and has lost it goes on as it does.
        wanted = free.gain_per_s * (wanted_speed - speed[n]) if wanted_speed < np.inf else 0.0
        if own_road[n] < np.inf:
            wanted = min(wanted, free.strongest_mps2)
        moved[ACCEL, n] = accel[n] + free.approach * (wanted - accel[n]) + free.noise_mps2 * own_normal[0, n]
    for k in range(first_follower, last_follower):
        n = followers[k]
        hardest = _hardest_that_avoids(gap[n], state[SPEED, n] - leader_speed[n])
        after[ACCEL, n] = min(sampled[k], hardest)
    for n in range(end - begin):
        held = min(max(moved[ACCEL, n], -HARDEST_BRAKING_MPS2), STRONGEST_ACCEL_MPS2)
        next_speed = max(speed[n] + held * dt_s, 0.0)
        moved[LON, n] = lon[n] + 0.5 * dt_s * (speed[n] + next_speed)
        moved[SPEED, n] = next_speed
        moved[ACCEL, n] = 0.0 if next_speed == 0.0 and held < 0.0 else held
    own_right, own_left, own_offset = lane_right[begin:end], lane_left[begin:end], offset[begin:end]
    for n in range(end - begin):
        away = lat[n] - 0.5 * (own_right[n] + own_left[n]) - own_offset[n]
        pull = -holding.attraction_per_s2 * away - holding.damping_per_s * lat_speed[n]
        # A ramp takes its own course.
        pull = pull if abs(away) < np.inf else 0.0
        next_lat_speed = lat_speed[n] + pull * dt_s + holding.kick_mps * own_normal[1, n]
        moved[LAT, n] = lat[n] + 0.5 * dt_s * (lat_speed[n] + next_lat_speed)
        moved[LAT_SPEED, n] = next_lat_speed
        moved[LAT_ACCEL, n] = pull


@part_of_kernel()
def _hardest_that_avoids(gap: float, closing: float) -> float:
    """Return the acceleration that just avoids the leader where that takes real braking, infinity elsewhere.

    Training data hold no near misses, so that the mixture has to be told of them. Below a gap of 2 m vehicles of one
    lane drive side by side more often than they touch, and are left to the mixture.
    """
    needed = closing * closing / (2.0 * max(gap - AVOIDED_BY_M, AVOIDED_BY_M))
    is_near = (closing > 0.0) & (gap > SIDE_BY_SIDE_BELOW_M) & (needed > BRAKING_WORTH_IT_MPS2)
    return -needed if is_near else np.inf
