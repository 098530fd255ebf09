"""The paper's short-term model for lane keeping (GSM): 28 components, five inputs, four outputs, one step ahead."""

from functools import partial
from pathlib import Path

import numpy as np

from mmpf.motion.gmm.model_file import MixtureFile, committed_mixture
from mmpf.motion.gmm.scaled import ScaledGmm
from mmpf.motion.kinematic import HARDEST_BRAKING_MPS2, STRONGEST_ACCEL_MPS2
from mmpf.motion.protocol import Memoryless, Surroundings, offset_in_lane
from mmpf.motion.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray

SHORT = MixtureFile("lane-keeping-short", inputs=5, outputs=4)
TRAINED_STEP_S = 0.1
FASTEST_SIDEWAYS_MPS = 2.0


def short_term_driver(mixture: ScaledGmm | None = None) -> Memoryless:
    """Return GSM: next lateral position, advance, speed and acceleration sampled from the conditional mixture.

    Without a leader the input is the furthest leader of the training data at the particle's own speed.

    Args:
        mixture: Five inputs as in ``short_inputs``, four outputs: lateral position in the lane, advance, speed and
            acceleration 0.1 s later. The committed one if None.
    """
    return Memoryless("gmm-short", partial(_step, mixture or committed_mixture(SHORT)))


def load_short_driver(path: Path) -> Memoryless:
    """Read a fitted model; ``ModelFileError`` says that the file can't be used."""
    return short_term_driver(SHORT.load(path))


def short_inputs(
    offset_m: FloatArray,
    distance_m: FloatArray,
    speed_mps: FloatArray,
    accel_mps2: FloatArray,
    leader_speed_mps: FloatArray,
) -> FloatArray:
    """Return the paper's inputs: lateral position in the lane, distance front to front, v, a, leader's v; (n, 5)."""
    return np.stack([offset_m, distance_m, speed_mps, accel_mps2, leader_speed_mps], axis=1)


def _step(
    mixture: ScaledGmm, state: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator
) -> FloatArray:
    low, high = mixture.scaling.input_low, mixture.scaling.input_high
    leader, before = surroundings.leader, state[SPEED]
    offset = offset_in_lane(state[LAT], surroundings.lane_right_m, surroundings.lane_left_m)
    distance = np.where(leader.exists, leader.gap_m + leader.length_m, high[1])
    leader_speed = np.where(leader.exists, leader.speed_mps, before)
    x = short_inputs(offset, distance, before, state[ACCEL], leader_speed)
    next_offset, advance, speed, accel = mixture.sample(x, rng).T
    steps = dt_s / TRAINED_STEP_S
    moved_m = next_offset - np.clip(offset, low[0], high[0])
    change = speed - np.clip(before, low[2], high[2])
    change = np.clip(change, -HARDEST_BRAKING_MPS2 * TRAINED_STEP_S, STRONGEST_ACCEL_MPS2 * TRAINED_STEP_S)
    after = np.empty_like(state)
    after[SPEED] = np.maximum(before + steps * change, 0.0)
    furthest = dt_s * np.maximum(before, after[SPEED]) + 0.05
    after[LON] = state[LON] + np.clip(_advance(steps * advance, before, after[SPEED], dt_s), 0.0, furthest)
    after[LAT_SPEED] = np.clip(moved_m / TRAINED_STEP_S, -FASTEST_SIDEWAYS_MPS, FASTEST_SIDEWAYS_MPS)
    after[LAT] = state[LAT] + dt_s * after[LAT_SPEED]
    after[ACCEL] = np.clip(accel, -HARDEST_BRAKING_MPS2, STRONGEST_ACCEL_MPS2)
    after[LAT_ACCEL] = 0.0
    return after


def _advance(sampled_m: FloatArray, speed_before: FloatArray, speed_after: FloatArray, dt_s: float) -> FloatArray:
    """Return the sampled advance where it fits the speeds, else the one that follows from them."""
    by_speeds = 0.5 * dt_s * (speed_before + speed_after)
    fits = np.abs(sampled_m - by_speeds) < 0.1 + 0.1 * by_speeds
    return np.where(fits, sampled_m, by_speeds)
