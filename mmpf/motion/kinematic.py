"""Constant velocity and constant acceleration: the plain kinematic models."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mmpf.compute.arrays import FloatArray
from mmpf.motion.kinematics import ProcessNoise, move_along, no_latents, process_noise
from mmpf.motion.protocol import Surroundings, motion_models
from mmpf.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED, STATE_SIZE


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


TIGHTEST_CURVATURE_PER_M = 0.2
SLOWEST_STEERED_MPS = 1.0
LARGEST_HEADING_RAD = 0.5


@dataclass(frozen=True)
class ConstantSteeringVelocity:
    """CSAV: path speed and steering angle stay, but for noise on the speed and on the lateral acceleration.

    Attributes:
        noise: ``lon`` drives the path speed, m/s per root second; ``lat`` the lateral acceleration, m/s² per root
            second.
        name: Name in the registry.
        latent_size: No latents.
    """

    noise: ProcessNoise = field(default_factory=lambda: process_noise("csav"))
    name: str = "csav"
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
        path_speed = np.hypot(state[SPEED], state[LAT_SPEED])
        next_path_speed = np.maximum(path_speed + self.noise.lon * lon_kick, 0.0)
        next_accel = np.zeros(state.shape[1])
        return _steer(state, path_speed, next_path_speed, next_accel, self.noise.lat * lat_kick, dt_s=dt_s), latents


@dataclass(frozen=True)
class ConstantSteeringAcceleration:
    """CSAA: path acceleration and steering angle stay, but for noise on both accelerations.

    Attributes:
        noise: Drives the accelerations along and across the road, m/s² per root second.
        name: Name in the registry.
        latent_size: No latents.
    """

    noise: ProcessNoise = field(default_factory=lambda: process_noise("csaa"))
    name: str = "csaa"
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
        path_speed = np.hypot(state[SPEED], state[LAT_SPEED])
        accel = state[ACCEL] + self.noise.lon * lon_kick
        next_path_speed = np.maximum(path_speed + 0.5 * (state[ACCEL] + accel) * dt_s, 0.0)
        accel = np.where((next_path_speed == 0.0) & (accel < 0.0), 0.0, accel)
        return _steer(state, path_speed, next_path_speed, accel, self.noise.lat * lat_kick, dt_s=dt_s), latents


def _steer(
    before: FloatArray,
    path_speed: FloatArray,
    next_path_speed: FloatArray,
    next_accel: FloatArray,
    lat_accel_kick: FloatArray,
    *,
    dt_s: float,
) -> FloatArray:
    """Return the states after a step along an arc of the curvature that the lateral acceleration implies."""
    steered_speed = np.maximum(path_speed, SLOWEST_STEERED_MPS)
    curvature = _bounded_curvature((before[LAT_ACCEL] + lat_accel_kick) / steered_speed**2)
    mean_speed = 0.5 * (path_speed + next_path_speed)
    heading = _bounded_heading(np.arctan2(before[LAT_SPEED], before[SPEED]))
    next_heading = _bounded_heading(heading + mean_speed * curvature * dt_s)
    mid_heading = 0.5 * (heading + next_heading)
    after = np.empty((STATE_SIZE, before.shape[1]))
    after[LON] = before[LON] + mean_speed * np.cos(mid_heading) * dt_s
    after[LAT] = before[LAT] + mean_speed * np.sin(mid_heading) * dt_s
    after[SPEED] = next_path_speed * np.cos(next_heading)
    after[LAT_SPEED] = next_path_speed * np.sin(next_heading)
    after[ACCEL] = next_accel
    after[LAT_ACCEL] = curvature * np.maximum(next_path_speed, SLOWEST_STEERED_MPS) ** 2
    return after


def _bounded_curvature(curvature: FloatArray) -> FloatArray:
    return np.clip(curvature, -TIGHTEST_CURVATURE_PER_M, TIGHTEST_CURVATURE_PER_M)


def _bounded_heading(heading: FloatArray) -> FloatArray:
    return np.clip(heading, -LARGEST_HEADING_RAD, LARGEST_HEADING_RAD)


motion_models.register("csav")(ConstantSteeringVelocity)
motion_models.register("csaa")(ConstantSteeringAcceleration)
