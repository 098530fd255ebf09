"""A particle filter per case, all cases at once: prediction by a motion model, update by very noisy measurements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from harness.study.cases import Cases
from mmpf.motion.protocol import MotionModel
from mmpf.road import FloatArray, IntArray
from mmpf.state import LAT, LON, SPEED

MEASURED = (LON, LAT, SPEED)
KERNEL_WIDTH = 0.1


@dataclass(frozen=True)
class MeasurementNoise:
    """Standard deviations of the measurements under partial occlusion; about ten times a lidar's in plain view.

    Attributes:
        lon_m: Longitudinal position.
        lat_m: Lateral position.
        speed_mps: Longitudinal speed.
    """

    lon_m: float = 2.0
    lat_m: float = 0.6
    speed_mps: float = 2.0

    def as_column(self) -> FloatArray:
        """Return the deviations in the order of ``MEASURED``, shape (3, 1)."""
        return np.array([[self.lon_m], [self.lat_m], [self.speed_mps]])


@dataclass(frozen=True)
class Cloud:
    """Particles of all cases after one step.

    Attributes:
        step: The step's number.
        state: States, shape (6, m, p).
        weight: Weights that sum to one in each case, shape (m, p).
    """

    step: int
    state: FloatArray
    weight: FloatArray


def measure(cases: Cases, noise: MeasurementNoise, rng: np.random.Generator) -> FloatArray:
    """Draw the measurements of all steps, shape (steps, 3, m); the same ones are given to every model."""
    true = cases.truth[:, list(MEASURED), :]
    return np.asarray(true + noise.as_column() * rng.standard_normal(true.shape))


def follow(
    model: MotionModel,
    cases: Cases,
    particles: int,
    rng: np.random.Generator,
    measurements: FloatArray | None = None,
    noise: MeasurementNoise | None = None,
) -> Iterator[Cloud]:
    """Yield the particles after every step, starting from the true initial state.

    Args:
        model: Predicts.
        cases: What to follow.
        particles: Particles per case.
        rng: Source of randomness.
        measurements: As from ``measure``; None for complete occlusion, in which nothing is measured after the start.
        noise: Noise of the measurements.
    """
    state = np.repeat(cases.truth[0], particles, axis=1)
    latents = model.draw_latents(state, rng)
    log_weight = np.zeros((cases.count, particles))
    hidden = measurements is None
    for step in range(1, cases.steps):
        around = cases.surroundings(state, step - 1, hidden)
        state, latents = model.propagate(state, latents, around, cases.step_s, rng)
        if measurements is not None and noise is not None:
            away = state[list(MEASURED)].reshape(3, cases.count, particles) - measurements[step][:, :, None]
            log_weight -= 0.5 * ((away / noise.as_column()[:, :, None]) ** 2).sum(axis=0)
        weight = _normalised(log_weight)
        yield Cloud(step, state.reshape(6, cases.count, particles), weight)
        if measurements is not None:
            kept = _survivors(weight, rng)
            state, latents = _spread_out(state[:, kept], cases.count, rng), latents[:, kept]
            log_weight = np.zeros_like(log_weight)


def _spread_out(state: FloatArray, cases: int, rng: np.random.Generator) -> FloatArray:
    """Draw resampled copies apart without changing each case's mean and variance (Liu and West, 2001)."""
    cloud = state.reshape(len(state), cases, -1)
    mean, deviation = cloud.mean(axis=2, keepdims=True), cloud.std(axis=2, keepdims=True)
    held = np.sqrt(1.0 - KERNEL_WIDTH**2) * (cloud - mean)
    spread = mean + held + KERNEL_WIDTH * deviation * rng.standard_normal(cloud.shape)
    spread[SPEED] = np.maximum(spread[SPEED], 0.0)
    return np.asarray(spread.reshape(state.shape))


def _normalised(log_weight: FloatArray) -> FloatArray:
    weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
    return np.asarray(weight / weight.sum(axis=1, keepdims=True))


def _survivors(weight: FloatArray, rng: np.random.Generator) -> IntArray:
    """Return indices into the flat particle axis by systematic resampling within each case, shape (m * p,)."""
    cases, particles = weight.shape
    cumulative = np.cumsum(weight, axis=1)
    cumulative /= cumulative[:, -1:]
    pointer = (rng.random((cases, 1)) + np.arange(particles)) / particles
    row = np.arange(cases)[:, None]
    flat = np.searchsorted((cumulative + 2.0 * row).ravel(), (pointer + 2.0 * row).ravel(), side="left")
    return np.asarray(np.minimum(flat, np.repeat((np.arange(cases) + 1) * particles - 1, particles)))
