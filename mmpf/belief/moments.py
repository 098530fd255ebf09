"""Means, covariances and effective sample sizes of components."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmpf.belief.mixture import Mixture
from mmpf.motion.state import LAT, LON, STATE_SIZE
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.numerics.kernels import kernel
from mmpf.numerics.threads import in_shares
from mmpf.scan import Detections


@dataclass(frozen=True)
class Moments:
    """Weighted moments of each of m components.

    Attributes:
        mean: Mean state, shape (6, m).
        variance: Variance of each state variable, shape (6, m).
        heading_rad: Where each component's vehicle points on the average against the frame's longitudinal axis, shape
            (m,); 0 on a road along which they point.
        has_headings: Whether they may point any way.
    """

    mean: FloatArray
    variance: FloatArray
    heading_rad: FloatArray
    has_headings: bool = False

    @property
    def std(self) -> FloatArray:
        """Standard deviations, shape (6, m)."""
        return np.sqrt(self.variance)

    @property
    def std_along_m(self) -> FloatArray:
        """Standard deviation along the road, shape (m,); in the plane that of the position."""
        variance = self.variance[LON] + self.variance[LAT] if self.has_headings else self.variance[LON]
        return np.asarray(np.sqrt(variance))

    @property
    def std_across_m(self) -> FloatArray:
        """Standard deviation across the road, shape (m,); in the plane that of the position."""
        return self.std_along_m if self.has_headings else np.asarray(np.sqrt(self.variance[LAT]))

    def take(self, index: IntArray | BoolArray) -> Moments:
        """Return the moments of some components, by number, shape (k,), or by a mask, shape (m,)."""
        return Moments(self.mean[:, index], self.variance[:, index], self.heading_rad[index], self.has_headings)

    def followed_by(self, then: Moments) -> Moments:
        """Return these moments followed by those of another belief."""
        return Moments(
            np.concatenate([self.mean, then.mean], axis=1),
            np.concatenate([self.variance, then.variance], axis=1),
            np.concatenate([self.heading_rad, then.heading_rad]),
            self.has_headings,
        )


def component_moments(mixture: Mixture, weight: FloatArray | None = None, since: int = 0) -> Moments:
    """Return the moments of the components from number ``since`` on under their particles' weights.

    They take a pass over the particles: whoever needs them in several places works them out once and hands them on.

    Args:
        mixture: The belief; weights sum to one in each component.
        weight: The particles' weights where they are known already, shape (n,).
    """
    weight = np.exp(mixture.cloud.log_weight) if weight is None else weight
    heading = _mean_directions(mixture, weight) if mixture.has_headings else np.zeros(len(mixture))
    found = state_moments(mixture, np.arange(since, len(mixture)), weight)
    return Moments(*found, heading[since:], mixture.has_headings)


def state_moments(mixture: Mixture, which: IntArray, weight: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of the states of some components, (k,), by particles' weights, (n,): each (6, k)."""
    mean, variance = np.zeros((2, STATE_SIZE, len(which)))
    state, starts = mixture.cloud.state, mixture.starts

    def accumulate(begin: int, end: int) -> None:
        _accumulate_moments(begin, end, which, state, weight, starts, mean, variance)

    in_shares(accumulate, len(which), cost=500.0)
    return mean, variance


def effective_sizes(mixture: Mixture, weight: FloatArray | None = None) -> FloatArray:
    """Return each component's effective sample size 1 / sum w^2, shape (m,); w are given where they are known."""
    squares = totals(np.square(np.exp(mixture.cloud.log_weight) if weight is None else weight), mixture.starts)
    return np.divide(1.0, squares, out=np.zeros(len(mixture)), where=squares > 0.0)


def gate_table(
    moments: Moments, detections: Detections, gate_std: float, noise_factor: FloatArray | None = None
) -> BoolArray:
    """Return which detections lie within each component's gate along and across the road, shape (m, d).

    Args:
        moments: The components' moments.
        detections: The scan's detections.
        gate_std: Standard deviations of component and measurement together; infinite for all pairs.
        noise_factor: True over reported deviation of each component's measurements, shape (m,); None for one.
    """
    if np.isinf(gate_std):
        return np.ones((moments.mean.shape[1], len(detections)), dtype=np.bool_)
    factor = np.ones((1, 1)) if noise_factor is None else noise_factor[:, None]
    lon = np.sqrt(moments.variance[LON][:, None] + (factor * detections.std_lon_m) ** 2)
    lat = np.sqrt(moments.variance[LAT][:, None] + (factor * detections.std_lat_m) ** 2)
    return np.asarray(
        (np.abs(detections.lon_m - moments.mean[LON][:, None]) <= gate_std * lon)
        & (np.abs(detections.lat_m - moments.mean[LAT][:, None]) <= gate_std * lat)
    )


def _mean_directions(mixture: Mixture, weight: FloatArray) -> FloatArray:
    """Return the directions of the components' mean unit vectors, shape (m,)."""
    heading, component = mixture.cloud.latents[-1], mixture.cloud.component
    sine, cosine = (
        np.bincount(component, weight * part, minlength=len(mixture)) for part in (np.sin(heading), np.cos(heading))
    )
    return np.asarray(np.arctan2(sine, cosine))


@kernel(fastmath=True)
def _accumulate_moments(
    begin: int,
    end: int,
    which: IntArray,
    state: FloatArray,
    weight: FloatArray,
    starts: IntArray,
    mean: FloatArray,
    variance: FloatArray,
) -> None:
    # Loops run over slices from zero on: the compiler turns only those into vector instructions.
    for c in range(begin, end):
        own = slice(starts[which[c]], starts[which[c] + 1])
        own_weight = weight[own]
        for row in range(state.shape[0]):
            values = state[row, own]
            first = 0.0
            for n in range(len(own_weight)):
                first += own_weight[n] * values[n]
            second = 0.0
            for n in range(len(own_weight)):
                centred = values[n] - first
                second += own_weight[n] * centred * centred
            mean[row, c] = first
            variance[row, c] = second


@kernel(fastmath=True)
def totals(weight: FloatArray, starts: IntArray) -> FloatArray:
    """Return the sum of each component's numbers, shape (m,).

    Args:
        weight: A number of each particle, component after component, shape (n,).
        starts: Where each component's particles begin, and where the last one's end, shape (m + 1,).
    """
    total = np.zeros(len(starts) - 1)
    for m in range(len(starts) - 1):
        own = weight[starts[m] : starts[m + 1]]
        for n in range(len(own)):
            total[m] += own[n]
    return total
