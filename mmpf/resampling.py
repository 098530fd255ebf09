"""Systematic resampling within components, and the draw from a weighted Gaussian for young ones."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import numpy.typing as npt

from mmpf.road import FloatArray, IntArray
from mmpf.state import LAT, LAT_SPEED, LON, SPEED, Mixture


def resample(
    mixture: Mixture, which: npt.NDArray[np.bool_], particles: int, rng: np.random.Generator
) -> tuple[Mixture, IntArray]:
    """Resample the chosen components systematically to ``particles`` equally weighted particles each.

    Args:
        mixture: The belief; weights sum to one in each component.
        which: Components to resample, shape (m,).
        particles: Particles that each of them gets.
        rng: Source of randomness; one uniform number per component is drawn, resampled or not.

    Returns:
        The belief after resampling, and each particle's ancestor, shape (n',).
    """
    offsets = rng.uniform(size=len(mixture))
    if not which.any():
        return mixture, np.arange(len(mixture.cloud))
    starts = mixture.starts
    sizes = np.where(which, particles, np.diff(starts))
    component = np.repeat(np.arange(len(mixture)), sizes)
    ancestors = np.empty(sizes.sum(), dtype=np.int64)
    _systematic_ancestors(np.exp(mixture.cloud.log_weight), starts, which, offsets, particles, ancestors)
    cloud = mixture.cloud.take(ancestors, component)
    even = np.where(which[component], -np.log(particles), cloud.log_weight)
    return replace(mixture, cloud=replace(cloud, log_weight=even)), ancestors


def resample_from_gaussian(
    mixture: Mixture, which: npt.NDArray[np.bool_], effective_size: FloatArray, rng: np.random.Generator
) -> Mixture:
    """Replace position and speed of the chosen components' particles by draws from their weighted Gaussian.

    The regularised particle filter with a Gaussian kernel of near-optimal width (Musso, Oudjane and Le Gland 2001);
    for components whose speed is still uncertain and whose cloud would impoverish.

    Args:
        mixture: The belief; all components have the same number of particles.
        which: Components to redraw, shape (m,).
        effective_size: Effective sample size of each component before resampling, shape (m,).
        rng: Source of randomness.
    """
    chosen = np.flatnonzero(which)
    if len(chosen) == 0:
        return mixture
    rows = np.array([LON, LAT, SPEED, LAT_SPEED])
    size = len(mixture.cloud) // len(mixture)
    particles = (chosen[:, None] * size + np.arange(size)).ravel()
    weight = np.exp(mixture.cloud.log_weight[particles]).reshape(len(chosen), 1, size)
    position = mixture.cloud.state[rows][:, particles].reshape(len(rows), len(chosen), size).transpose(1, 0, 2)
    mean = (position * weight).sum(axis=2, keepdims=True)
    centred = position - mean
    covariance = (centred * weight) @ centred.transpose(0, 2, 1)
    widening = 1.0 + effective_size[chosen, None, None] ** (-2.0 / 9.0)
    factor = np.linalg.cholesky(covariance * widening + 1e-9 * np.eye(len(rows)))
    drawn = mean + factor @ rng.standard_normal((len(chosen), len(rows), size))
    state = mixture.cloud.state.copy()
    state[np.ix_(rows, particles)] = drawn.transpose(1, 0, 2).reshape(len(rows), -1)
    state[SPEED] = np.maximum(state[SPEED], 0.0)
    log_weight = mixture.cloud.log_weight.copy()
    log_weight[particles] = -np.log(size)
    return replace(mixture, cloud=replace(mixture.cloud, state=state, log_weight=log_weight))


@numba.njit(cache=True)
def _systematic_ancestors(
    weight: FloatArray,
    starts: IntArray,
    which: npt.NDArray[np.bool_],
    offsets: FloatArray,
    particles: int,
    ancestors: IntArray,
) -> None:
    out = 0
    for m in range(len(starts) - 1):
        begin, end = starts[m], starts[m + 1]
        if not which[m]:
            for n in range(begin, end):
                ancestors[out] = n
                out += 1
            continue
        total = 0.0
        for n in range(begin, end):
            total += weight[n]
        cumulative = weight[begin]
        n = begin
        for k in range(particles):
            target = (k + offsets[m]) / particles * total
            while cumulative < target and n < end - 1:
                n += 1
                cumulative += weight[n]
            ancestors[out] = n
            out += 1
