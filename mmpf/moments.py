"""Means, spreads and effective sizes of components: what the rest of the filter asks of a particle cloud."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from mmpf.road import FloatArray, IntArray
from mmpf.state import STATE_SIZE, Mixture
from mmpf.threads import in_shares


@dataclass(frozen=True)
class Moments:
    """Weighted moments of each of m components.

    Attributes:
        mean: Mean state, shape (6, m).
        variance: Variance of each state variable, shape (6, m).
        effective_size: Effective sample size 1 / sum w^2, shape (m,).
    """

    mean: FloatArray
    variance: FloatArray
    effective_size: FloatArray

    @property
    def std(self) -> FloatArray:
        """Standard deviations, shape (6, m)."""
        return np.sqrt(self.variance)


def component_moments(mixture: Mixture) -> Moments:
    """Return the moments of each component under its particles' weights.

    A cloud never changes, and several stages ask for its moments: they are worked out once and kept with it.
    """
    kept: dict[str, Moments] = vars(mixture.cloud)
    if "moments" not in kept:
        kept["moments"] = _moments(mixture)
    return kept["moments"]


def with_moments_of(mixture: Mixture, same: Mixture) -> Mixture:
    """Return the belief, told that its moments are those of another one with the same states and weights."""
    vars(mixture.cloud)["moments"] = component_moments(same)
    return mixture


def _moments(mixture: Mixture) -> Moments:
    mean = np.zeros((STATE_SIZE, len(mixture)))
    variance = np.zeros((STATE_SIZE, len(mixture)))
    effective_size = np.zeros(len(mixture))
    weight = np.exp(mixture.cloud.log_weight)
    state, starts = mixture.cloud.state, mixture.starts

    def accumulate(begin: int, end: int) -> None:
        _accumulate_moments(begin, end, state, weight, starts, mean, variance, effective_size)

    in_shares(accumulate, len(mixture), cost=500.0)
    return Moments(mean, variance, effective_size)


@numba.njit(cache=True, fastmath=True, nogil=True)
def _accumulate_moments(
    begin: int,
    end: int,
    state: FloatArray,
    weight: FloatArray,
    starts: IntArray,
    mean: FloatArray,
    variance: FloatArray,
    effective_size: FloatArray,
) -> None:
    # Loops run over slices from zero on: the compiler turns only those into vector instructions.
    for m in range(begin, end):
        own_weight = weight[starts[m] : starts[m + 1]]
        squares = 0.0
        for n in range(len(own_weight)):
            squares += own_weight[n] * own_weight[n]
        effective_size[m] = 1.0 / squares if squares > 0.0 else 0.0
        for row in range(state.shape[0]):
            values = state[row, starts[m] : starts[m + 1]]
            first = 0.0
            for n in range(len(own_weight)):
                first += own_weight[n] * values[n]
            second = 0.0
            for n in range(len(own_weight)):
                centred = values[n] - first
                second += own_weight[n] * centred * centred
            mean[row, m] = first
            variance[row, m] = second
