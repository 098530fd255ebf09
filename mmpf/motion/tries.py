"""Importance sampling of rare events: particles try them more often than vehicles do, and weights correct for it.

A vehicle may at any moment begin what few begin: a hard braking, a lane change. There must always be particles that try
it, or a filter finds out too late. So some motion models let particles in sight begin it more often than vehicles do.
They are then a proposal density, not the prior, and the ratio of the two belongs into the weights (equation (10)): what
is tried in vain costs nothing, whether a detection or none comes next.
"""

from typing import Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from mmpf.motion.protocol import BuildsOnAnother, MotionModel, Surroundings
from mmpf.numerics.arrays import BoolArray, FloatArray

SMALLEST, MOST_WAYS = 1e-12, 2
CASES = MOST_WAYS + 1


@runtime_checkable
class TriesMore(Protocol):
    """A motion model whose particles do some things more often than vehicles do."""

    def log_prior_over_tried(
        self, latents: FloatArray, after: FloatArray, surroundings: Surroundings, dt_s: float
    ) -> FloatArray:
        """Return the log ratio of how often vehicles do what particles did in a step, and how often particles do it.

        The mean of its exponential is one over what a particle may do, so that on the whole nothing is gained or lost.

        Args:
            latents: Latents before the step, shape (latent_size, n).
            after: Latents after it, likewise.
            surroundings: What the particles knew.
            dt_s: Length of the step.

        Returns:
            The logarithm of prior over proposal density, shape (n,).
        """


def log_prior_over_tried(
    motion: MotionModel, latents: FloatArray, after: FloatArray, surroundings: Surroundings, dt_s: float
) -> FloatArray:
    """Return the log ratio of each particle, shape (n,), which is zero if the model draws from its prior."""
    if isinstance(motion, TriesMore):
        return motion.log_prior_over_tried(latents, after, surroundings, dt_s)
    if isinstance(motion, BuildsOnAnother):
        own = motion.inner.latent_size
        return log_prior_over_tried(motion.inner, latents[:own], after[:own], surroundings, dt_s)
    return np.zeros(latents.shape[1])


def log_ratio_of_begun(
    begun: BoolArray, may_begin: BoolArray, true: float, tried: float, ways: int | npt.NDArray[np.integer] = 1
) -> FloatArray:
    """Return the log importance weight of particles that try something more often than vehicles do, shape (n,).

    Who began it gets log(true / tried), who could have and did not, log((1 - ways true) / (1 - ways tried)).

    Args:
        begun: Which particles began it in this step, shape (n,).
        may_begin: Which could have begun it, shape (n,); the log weight of the others is zero.
        true: Probability that a vehicle begins it in a step in one given way, such as a lane change to the left.
        tried: Probability that a particle does.
        ways: Number of ways open to each particle: 0, 1 or 2.
    """
    # One look-up takes a tenth of the time of choices one within the other, and look-ups are made by whole words.
    case = np.int8(2 * CASES) * may_begin + np.int8(CASES) * begun + ways
    return log_ratios(true, tried).take(case.astype(np.intp))


def log_ratios(true: float, tried: float) -> FloatArray:
    """Return the log ratios of ``log_ratio_of_begun``, ``CASES`` each for particles of four kinds, by their ways.

    First come those that could not begin it, and did not or did, then those that could, likewise.
    """
    did = np.log(max(true, SMALLEST)) - np.log(max(tried, SMALLEST))
    none_of = (np.log(np.maximum(1.0 - np.arange(CASES) * chance, SMALLEST)) for chance in (true, tried))
    return np.concatenate([np.zeros(2 * CASES), np.subtract(*none_of), np.full(CASES, did)])
