"""Motion along and across the road that several models share."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np

from mmpf.compute.arrays import FloatArray
from mmpf.motion.protocol import Surroundings
from mmpf.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED

LANE_ATTRACTION_PER_S2 = 0.1
LANE_DAMPING_PER_S = 0.7
HARDEST_BRAKING_MPS2 = 9.0
STRONGEST_ACCEL_MPS2 = 5.0


def no_latents(state: FloatArray) -> FloatArray:
    """Return the empty latents of a memoryless model for states of shape (6, n): shape (0, n)."""
    return np.empty((0, state.shape[1]))


def move_along(
    before: FloatArray, after: FloatArray, accel_mps2: FloatArray, speed_kick: FloatArray, dt_s: float
) -> None:
    """Write longitudinal position, speed and acceleration after a step of given acceleration.

    A vehicle that would reverse stands still instead.

    Args:
        before: States at the step's start, shape (6, n).
        after: States at its end, shape (6, n); three rows are written.
        accel_mps2: Acceleration over the step, shape (n,).
        speed_kick: Noise on the speed, m/s, shape (n,).
        dt_s: Length of the step.
    """
    speed = np.maximum(before[SPEED] + accel_mps2 * dt_s + speed_kick, 0.0)
    after[LON] = before[LON] + 0.5 * dt_s * (before[SPEED] + speed)
    after[SPEED] = speed
    after[ACCEL] = np.where((speed == 0.0) & (accel_mps2 < 0.0), 0.0, accel_mps2)


def keep_lane(
    before: FloatArray,
    after: FloatArray,
    surroundings: Surroundings,
    noise: ProcessNoise,
    *,
    dt_s: float,
    rng: np.random.Generator,
) -> None:
    """Write the lateral rows of vehicles that drift back to the middle of their lane as damped springs do.

    Args:
        before: States at the step's start, shape (6, n).
        after: States at its end, shape (6, n); the lateral rows are written.
        surroundings: Where the lane lines are; where they are not finite the vehicle only damps its lateral speed.
        noise: Its ``lat`` drives the lateral speed.
        dt_s: Length of the step.
        rng: Source of randomness.
    """
    centre = 0.5 * (surroundings.lane_right_m + surroundings.lane_left_m)
    offset = np.where(np.isfinite(centre), before[LAT] - centre, 0.0)
    pull = -LANE_ATTRACTION_PER_S2 * offset - LANE_DAMPING_PER_S * before[LAT_SPEED]
    kick = noise.lat * np.sqrt(dt_s) * rng.standard_normal(before.shape[1])
    lat_speed = before[LAT_SPEED] + pull * dt_s + kick
    after[LAT] = before[LAT] + 0.5 * dt_s * (before[LAT_SPEED] + lat_speed)
    after[LAT_SPEED] = lat_speed
    after[LAT_ACCEL] = pull


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
def process_noise_table() -> dict[str, ProcessNoise]:
    """Return the committed noise of every kinematic model by its name."""
    text = files("mmpf.models").joinpath("process_noise.toml").read_text(encoding="utf-8")
    return {name: ProcessNoise(**sizes) for name, sizes in tomllib.loads(text).items()}


def process_noise(model: str) -> ProcessNoise:
    """Return the committed noise of one model."""
    return process_noise_table()[model]
