"""A particle filter for each case, all cases at once, and its scores: errors, coverage and sharpness at each step.

A motion model predicts; noisy measurements, where there are any, update.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from harness.lab.windows.cases import Cases
from harness.truth.frame import STEP_S
from mmpf.belief.mixture import Components, Mixture, ParticleCloud
from mmpf.belief.moments import effective_sizes
from mmpf.belief.resampling import resample_smoothly
from mmpf.motion.protocol import MotionModel
from mmpf.motion.state import LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray, IntArray
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
    model: MotionModel, cases: Cases, particles: int, rng: np.random.Generator, measurements: FloatArray | None = None
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


QUANTITIES = {"lon_m": LON, "lat_m": LAT, "speed_mps": SPEED, "lat_speed_mps": LAT_SPEED}
INTERVAL = (0.025, 0.975)
HORIZONS_S = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True)
class Scores:
    """How one model did under one occlusion; arrays over steps and cases.

    Attributes:
        abs_error: Absolute error of the particles' mean by quantity, each of shape (steps - 1, m).
        covered: Whether the 95 % particle interval holds the truth, by quantity, each of shape (steps - 1, m).
        crps_m: Continuous ranked probability score of the longitudinal position, shape (steps - 1, m).
        traffic: A number that cases of the same recording share, shape (m,).
    """

    abs_error: dict[str, FloatArray]
    covered: dict[str, npt.NDArray[np.bool_]]
    spread: dict[str, FloatArray]
    crps_m: FloatArray
    traffic: IntArray


def score(clouds: Iterable[Cloud], cases: Cases) -> Scores:
    """Score every step's particles."""
    shape = (cases.steps - 1, cases.count)
    error = {name: np.empty(shape) for name in QUANTITIES}
    covered = {name: np.empty(shape, dtype=np.bool_) for name in QUANTITIES}
    spread = {name: np.empty(shape) for name in QUANTITIES}
    crps = np.empty(shape)
    for cloud in clouds:
        for name, row in QUANTITIES.items():
            values, true = cloud.state[row], cases.truth[cloud.step, row]
            mean = (cloud.weight * values).sum(axis=1)
            error[name][cloud.step - 1] = np.abs(mean - true)
            spread[name][cloud.step - 1] = np.sqrt((cloud.weight * (values - mean[:, None]) ** 2).sum(axis=1))
            below = (cloud.weight * (values < true[:, None])).sum(axis=1)
            up_to = (cloud.weight * (values <= true[:, None])).sum(axis=1)
            covered[name][cloud.step - 1] = (up_to >= INTERVAL[0]) & (below <= INTERVAL[1])
        crps[cloud.step - 1] = weighted_crps(cloud.state[LON], cloud.weight, cases.truth[cloud.step, LON])
    return Scores(error, covered, spread, crps, cases.traffic)


def weighted_crps(values: FloatArray, weight: FloatArray, true: FloatArray) -> FloatArray:
    """Return the continuous ranked probability score, shape (m,), of samples whose weights sum to one, both (m, p)."""
    order = np.argsort(values, axis=1)
    values, weight = np.take_along_axis(values, order, axis=1), np.take_along_axis(weight, order, axis=1)
    cumulative = np.cumsum(weight, axis=1)
    half_mean_distance = (weight * values * (2.0 * cumulative - weight - 1.0)).sum(axis=1)
    return np.asarray((weight * np.abs(values - true[:, None])).sum(axis=1) - half_mean_distance)
