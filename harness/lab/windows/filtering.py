"""A particle filter for each case, all cases at once: prediction by a motion model, update by noisy measurements."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from harness.lab.windows.cases import Cases
from harness.truth.frame import STEP_S
from mmpf.belief.mixture import Components, Mixture, ParticleCloud
from mmpf.belief.moments import effective_sizes
from mmpf.belief.resampling import resample_smoothly
from mmpf.motion.protocol import MotionModel
from mmpf.motion.state import LAT, LON, SPEED
from mmpf.numerics.arrays import FloatArray
from mmpf.options.joint import JointResampling

MEASURED = [LON, LAT, SPEED]
NOISE = {"lon_m": 2.0, "lat_m": 0.6, "speed_mps": 2.0}
"""Standard deviations of what is measured under partial occlusion; about ten times a lidar's in plain view."""
STDS = np.array(list(NOISE.values()))[:, None]
RESAMPLING = JointResampling()


@dataclass(frozen=True)
class Cloud:
    """Particles of all cases after one step.

    Attributes:
        state: States, shape (6, m, p).
        weight: Weights that sum to one in each case, shape (m, p).
    """

    step: int
    state: FloatArray
    weight: FloatArray


def measure(cases: Cases, rng: np.random.Generator) -> FloatArray:
    """Draw the measurements of all steps, shape (steps, 3, m); the same ones are given to every model."""
    true = cases.truth[:, MEASURED]
    return np.asarray(true + STDS * rng.standard_normal(true.shape))


def follow(
    model: MotionModel,
    cases: Cases,
    particles: int,
    rng: np.random.Generator,
    measurements: FloatArray | None = None,
) -> Iterator[Cloud]:
    """Yield the particles after every step, starting from the true initial state.

    Without what ``measure`` drew, the occlusion is complete: nothing is measured after the start.
    """
    state = np.repeat(cases.truth[0], particles, axis=1)
    belief = _belief(state, model.draw_latents(state, rng), np.zeros(state.shape[1]), cases.count)
    hidden = measurements is None
    for step in range(1, cases.steps):
        around = cases.surroundings(belief.cloud.state, step - 1, hidden)
        state, latents = model.propagate(belief.cloud.state, belief.cloud.latents, around, STEP_S, rng)
        log_weight = belief.cloud.log_weight.reshape(cases.count, particles)
        if measurements is not None:
            away = state[MEASURED].reshape(3, cases.count, particles) - measurements[step][:, :, None]
            log_weight = log_weight - 0.5 * ((away / STDS[:, :, None]) ** 2).sum(axis=0)
        weight = np.exp(log_weight - log_weight.max(axis=1, keepdims=True))
        weight /= weight.sum(axis=1, keepdims=True)
        yield Cloud(step, state.reshape(6, cases.count, particles), weight)
        belief = _belief(state.copy(), latents, np.log(np.maximum(weight.ravel(), 1e-300)), cases.count)
        if measurements is not None:
            depleted = effective_sizes(belief) < RESAMPLING.effective_share * particles
            width = np.full(cases.count, RESAMPLING.kernel_width)
            belief = resample_smoothly(belief, depleted, particles, width, rng)


def _belief(state: FloatArray, latents: FloatArray, log_weight: FloatArray, cases: int) -> Mixture:
    """Return the particles as the tracker's belief with a component for each case."""
    component = np.repeat(np.arange(cases), state.shape[1] // cases)
    cloud = ParticleCloud(state, log_weight, log_weight, component, np.zeros(len(component)), latents)
    return Mixture(cloud, Components.newborn(np.arange(cases), np.ones(cases)))
