"""Constant velocity and constant acceleration: the plain kinematic models."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mmpf.motion.kinematics import move_along, no_latents
from mmpf.motion.process_noise import ProcessNoise, process_noise
from mmpf.motion.protocol import Surroundings, motion_models
from mmpf.road import FloatArray
from mmpf.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED


@dataclass(frozen=True)
class ConstantVelocity:
    """CVM: both velocities stay, but for white acceleration noise.

    Attributes:
        noise: Drives the speeds, m/s per root second.
        name: Name in the registry.
        latent_size: No latents.
    """

    noise: ProcessNoise = field(default_factory=lambda: process_noise("cvm"))
    name: str = "cvm"
    latent_size: int = 0

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Return no latents, shape (0, n)."""
        return no_latents(state)

    def propagate(
        self,
        state: FloatArray,
        latents: FloatArray,
        surroundings: Surroundings,  # noqa: ARG002
        dt_s: float,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray]:
        """Sample the states one step later; see ``MotionModel.propagate``."""
        lon_kick, lat_kick = np.sqrt(dt_s) * rng.standard_normal((2, state.shape[1]))
        after = np.empty_like(state)
        move_along(state, after, np.zeros(state.shape[1]), self.noise.lon * lon_kick, dt_s)
        after[LAT_SPEED] = state[LAT_SPEED] + self.noise.lat * lat_kick
        after[LAT] = state[LAT] + 0.5 * dt_s * (state[LAT_SPEED] + after[LAT_SPEED])
        after[LAT_ACCEL] = 0.0
        return after, latents


@dataclass(frozen=True)
class ConstantAcceleration:
    """CAM: both accelerations stay, but for white jerk noise.

    Attributes:
        noise: Drives the accelerations, m/s² per root second.
        name: Name in the registry.
        latent_size: No latents.
    """

    noise: ProcessNoise = field(default_factory=lambda: process_noise("cam"))
    name: str = "cam"
    latent_size: int = 0

    def draw_latents(self, state: FloatArray, rng: np.random.Generator) -> FloatArray:  # noqa: ARG002
        """Return no latents, shape (0, n)."""
        return no_latents(state)

    def propagate(
        self,
        state: FloatArray,
        latents: FloatArray,
        surroundings: Surroundings,  # noqa: ARG002
        dt_s: float,
        rng: np.random.Generator,
    ) -> tuple[FloatArray, FloatArray]:
        """Sample the states one step later; see ``MotionModel.propagate``."""
        lon_kick, lat_kick = np.sqrt(dt_s) * rng.standard_normal((2, state.shape[1]))
        accel = state[ACCEL] + self.noise.lon * lon_kick
        after = np.empty_like(state)
        move_along(state, after, 0.5 * (state[ACCEL] + accel), np.zeros(state.shape[1]), dt_s)
        after[ACCEL] = np.where((after[ACCEL] == 0.0) & (accel < 0.0), 0.0, accel)
        after[LAT_ACCEL] = state[LAT_ACCEL] + self.noise.lat * lat_kick
        after[LAT_SPEED] = state[LAT_SPEED] + 0.5 * dt_s * (state[LAT_ACCEL] + after[LAT_ACCEL])
        after[LAT] = state[LAT] + 0.5 * dt_s * (state[LAT_SPEED] + after[LAT_SPEED])
        return after, latents


motion_models.register("cvm")(ConstantVelocity)
motion_models.register("cam")(ConstantAcceleration)
