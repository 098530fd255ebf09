"""The paper's short-term model for lane keeping (GSM): 28 components, five inputs, four outputs, one step ahead."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

from mmpf.compute.arrays import FloatArray
from mmpf.motion.gmm.model_file import load_arrays, mixture_from_arrays
from mmpf.motion.gmm.scaled import ScaledGmm
from mmpf.motion.kinematics import HARDEST_BRAKING_MPS2, STRONGEST_ACCEL_MPS2, no_latents
from mmpf.motion.protocol import Surroundings, motion_models
from mmpf.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED

CASE = "lane-keeping-short"
TRAINED_STEP_S = 0.1
FASTEST_SIDEWAYS_MPS = 2.0


def short_inputs(
    offset_m: FloatArray,
    distance_m: FloatArray,
    speed_mps: FloatArray,
    accel_mps2: FloatArray,
    leader_speed_mps: FloatArray,
) -> FloatArray:
    """Return the paper's inputs: lateral position in the lane, distance front to front, v, a, leader's v; (n, 5)."""
    return np.stack([offset_m, distance_m, speed_mps, accel_mps2, leader_speed_mps], axis=1)


@cache
def _committed_mixture() -> ScaledGmm:
    with as_file(files("mmpf.models").joinpath("lane_keeping_short.npz")) as path:
        return _load_mixture(path)


@dataclass(frozen=True)
class ShortTermDriver:
    """GSM: next lateral position, advance, speed and acceleration sampled from the conditional mixture.

    Without a leader the input is the furthest leader of the training data at the particle's own speed.

    Attributes:
        mixture: Five inputs as in ``short_inputs``, four outputs: lateral position in the lane, advance, speed and
            acceleration 0.1 s later.
        name: Name in the registry.
        latent_size: No latents.
    """

    mixture: ScaledGmm = field(default_factory=_committed_mixture)
    name: str = "gmm-short"
    latent_size: int = 0

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Return no latents, shape (0, n)."""
        return no_latents(state)

    def propagate(
        self,
        state: FloatArray,
        latents: FloatArray,
        surroundings: Surroundings,
        dt_s: float,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray]:
        """Sample the states one step later; see ``MotionModel.propagate``."""
        x = self._inputs(state, surroundings)
        offset, advance, speed, accel = self.mixture.sample(x, rng).T
        steps = dt_s / TRAINED_STEP_S
        before = state[SPEED]
        seen_offset = np.clip(x[:, 0], self.mixture.input_low[0], self.mixture.input_high[0])
        change = _bounded(speed - np.clip(before, self.mixture.input_low[2], self.mixture.input_high[2]))
        after = np.empty_like(state)
        after[SPEED] = np.maximum(before + steps * change, 0.0)
        furthest = dt_s * np.maximum(before, after[SPEED]) + 0.05
        after[LON] = state[LON] + np.clip(_advance(steps * advance, before, after[SPEED], dt_s), 0.0, furthest)
        after[LAT_SPEED] = np.clip((offset - seen_offset) / TRAINED_STEP_S, -FASTEST_SIDEWAYS_MPS, FASTEST_SIDEWAYS_MPS)
        after[LAT] = state[LAT] + dt_s * after[LAT_SPEED]
        after[ACCEL] = np.clip(accel, -HARDEST_BRAKING_MPS2, STRONGEST_ACCEL_MPS2)
        after[LAT_ACCEL] = 0.0
        return after, latents

    def _inputs(self, state: FloatArray, surroundings: Surroundings) -> FloatArray:
        leader = surroundings.leader
        centre = 0.5 * (surroundings.lane_right_m + surroundings.lane_left_m)
        offset = np.where(np.isfinite(centre), state[LAT] - centre, 0.0)
        distance = np.where(leader.exists, leader.gap_m + leader.length_m, self.mixture.input_high[1])
        leader_speed = np.where(leader.exists, leader.speed_mps, state[SPEED])
        return short_inputs(offset, distance, state[SPEED], state[ACCEL], leader_speed)


def load_short_driver(path: Path) -> ShortTermDriver:
    """Read a fitted model.

    Raises:
        ModelFileError: The file can't be used.
    """
    return ShortTermDriver(_load_mixture(path))


def _load_mixture(path: Path) -> ScaledGmm:
    return mixture_from_arrays(path, load_arrays(path, CASE), "joint", (5, 4))


def _bounded(speed_change_mps: FloatArray) -> FloatArray:
    return np.clip(speed_change_mps, -HARDEST_BRAKING_MPS2 * TRAINED_STEP_S, STRONGEST_ACCEL_MPS2 * TRAINED_STEP_S)


def _advance(sampled_m: FloatArray, speed_before: FloatArray, speed_after: FloatArray, dt_s: float) -> FloatArray:
    """Return the sampled advance where it fits the speeds, else the one that follows from them."""
    by_speeds = 0.5 * dt_s * (speed_before + speed_after)
    fits = np.abs(sampled_m - by_speeds) < 0.1 + 0.1 * by_speeds
    return np.where(fits, sampled_m, by_speeds)


motion_models.register("gmm-short")(ShortTermDriver)
