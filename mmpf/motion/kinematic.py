"""The kinematic models, and the noise and longitudinal motion that other models share with them."""

import tomllib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from importlib.resources import files
from typing import Any

import numpy as np

from mmpf.motion.protocol import Memoryless, Surroundings
from mmpf.motion.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED, STATE_SIZE
from mmpf.numerics.arrays import FloatArray

HARDEST_BRAKING_MPS2 = 9.0
STRONGEST_ACCEL_MPS2 = 5.0
TIGHTEST_CURVATURE_PER_M = 0.2
SLOWEST_STEERED_MPS = 1.0
LARGEST_HEADING_RAD = 0.5

KinematicStep = Callable[[FloatArray, FloatArray, FloatArray, float], FloatArray]


@dataclass(frozen=True)
class ProcessNoise:
    """White noise that drives a model, as root spectral densities.

    Attributes:
        lon: Along the road: m/s per root second where noise drives the speed, m/s² per root second where it drives
            the acceleration.
        lat: Across the road, likewise.
    """

    lon: float
    lat: float


@cache
def committed_table(file: str) -> dict[str, Any]:
    """Return the parameters in one of the TOML files that travel with the package."""
    return tomllib.loads(files("mmpf.models").joinpath(file).read_text(encoding="utf-8"))


def process_noise(model: str) -> ProcessNoise:
    """Return the committed noise of one model."""
    return ProcessNoise(**committed_table("process_noise.toml")[model])


def kinematic(name: str, noise: ProcessNoise | None = None) -> Memoryless:
    """Return a kinematic model.

    Args:
        name: ``cvm``, ``cam``, ``csav`` or ``csaa``: one of ``STEPS``.
        noise: What drives it; the committed noise of the model if None.
    """
    return Memoryless(name, partial(_driven_by_noise, STEPS[name], noise or process_noise(name)))


def _driven_by_noise(
    step: KinematicStep,
    noise: ProcessNoise,
    state: FloatArray,
    surroundings: Surroundings,  # noqa: ARG001  these models know of nothing around them
    dt_s: float,
    rng: np.random.Generator,
) -> FloatArray:
    lon_kick, lat_kick = np.sqrt(dt_s) * rng.standard_normal((2, state.shape[1]))
    return step(state, noise.lon * lon_kick, noise.lat * lat_kick, dt_s)


def constant_velocity(state: FloatArray, lon_kick: FloatArray, lat_kick: FloatArray, dt_s: float) -> FloatArray:
    """Return the states, shape (6, n), one step later by CVM: both velocities stay, but for kicks, m/s, shape (n,)."""
    after = np.empty_like(state)
    move_along(state, after, np.zeros(state.shape[1]), lon_kick, dt_s)
    after[LAT_SPEED] = state[LAT_SPEED] + lat_kick
    after[LAT] = state[LAT] + 0.5 * dt_s * (state[LAT_SPEED] + after[LAT_SPEED])
    after[LAT_ACCEL] = 0.0
    return after


def constant_acceleration(state: FloatArray, lon_kick: FloatArray, lat_kick: FloatArray, dt_s: float) -> FloatArray:
    """Return the states one step later by CAM: both accelerations stay, but for kicks, m/s², shape (n,)."""
    accel = state[ACCEL] + lon_kick
    after = np.empty_like(state)
    move_along(state, after, 0.5 * (state[ACCEL] + accel), 0.0, dt_s)
    after[ACCEL] = np.where((after[ACCEL] == 0.0) & (accel < 0.0), 0.0, accel)
    after[LAT_ACCEL] = state[LAT_ACCEL] + lat_kick
    after[LAT_SPEED] = state[LAT_SPEED] + 0.5 * dt_s * (state[LAT_ACCEL] + after[LAT_ACCEL])
    after[LAT] = state[LAT] + 0.5 * dt_s * (state[LAT_SPEED] + after[LAT_SPEED])
    return after


def constant_steering_velocity(
    state: FloatArray, lon_kick: FloatArray, lat_kick: FloatArray, dt_s: float
) -> FloatArray:
    """Return the states one step later by CSAV: path speed and steering angle stay, but for kicks of shape (n,).

    They act on the path speed, m/s, and on the lateral acceleration, m/s².
    """
    path_speed = np.hypot(state[SPEED], state[LAT_SPEED])
    return _steer(state, path_speed, np.maximum(path_speed + lon_kick, 0.0), np.zeros(len(path_speed)), lat_kick, dt_s)


def constant_steering_acceleration(
    state: FloatArray, lon_kick: FloatArray, lat_kick: FloatArray, dt_s: float
) -> FloatArray:
    """Return the states one step later by CSAA: path acceleration and steering angle stay, but for kicks, m/s²."""
    path_speed = np.hypot(state[SPEED], state[LAT_SPEED])
    accel = state[ACCEL] + lon_kick
    next_path_speed = np.maximum(path_speed + 0.5 * (state[ACCEL] + accel) * dt_s, 0.0)
    accel = np.where((next_path_speed == 0.0) & (accel < 0.0), 0.0, accel)
    return _steer(state, path_speed, next_path_speed, accel, lat_kick, dt_s)


def move_along(
    before: FloatArray, after: FloatArray, accel_mps2: FloatArray, speed_kick: FloatArray | float, dt_s: float
) -> None:
    """Write longitudinal position, speed and acceleration after a step of given acceleration.

    A vehicle that would reverse stands still instead.

    Args:
        before: States at the step's start, shape (6, n).
        after: States at its end, shape (6, n); three rows are written. May be ``before``.
        accel_mps2: Acceleration over the step, shape (n,).
        speed_kick: Noise on the speed, m/s, shape (n,), or one number for all.
        dt_s: Length of the step.
    """
    speed = np.maximum(before[SPEED] + accel_mps2 * dt_s + speed_kick, 0.0)
    after[LON] = before[LON] + 0.5 * dt_s * (before[SPEED] + speed)
    after[SPEED] = speed
    after[ACCEL] = np.where((speed == 0.0) & (accel_mps2 < 0.0), 0.0, accel_mps2)


def _steer(
    before: FloatArray,
    path_speed: FloatArray,
    next_path_speed: FloatArray,
    next_accel: FloatArray,
    lat_accel_kick: FloatArray,
    dt_s: float,
) -> FloatArray:
    """Return the states after a step along an arc of the curvature that the lateral acceleration implies."""
    steered_speed = np.maximum(path_speed, SLOWEST_STEERED_MPS)
    curvature = (before[LAT_ACCEL] + lat_accel_kick) / steered_speed**2
    curvature = np.clip(curvature, -TIGHTEST_CURVATURE_PER_M, TIGHTEST_CURVATURE_PER_M)
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


def _bounded_heading(heading: FloatArray) -> FloatArray:
    return np.clip(heading, -LARGEST_HEADING_RAD, LARGEST_HEADING_RAD)


STEPS: dict[str, KinematicStep] = {
    "cvm": constant_velocity,
    "cam": constant_acceleration,
    "csav": constant_steering_velocity,
    "csaa": constant_steering_acceleration,
}
CVM, CAM, CSAV, CSAA = (partial(kinematic, name) for name in STEPS)
