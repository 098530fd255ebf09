"""Systematic resampling within components, and the draw from a weighted Gaussian for young ones."""

from __future__ import annotations

from dataclasses import replace

import numba
import numpy as np
import numpy.typing as npt

from mmpf.moments import component_moments
from mmpf.normals import Float32Array, standard_normals
from mmpf.road import FloatArray, IntArray
from mmpf.state import LAT, LAT_SPEED, LON, SPEED, Mixture, ParticleCloud
from mmpf.threads import in_shares

REDRAWN = (LON, LAT, SPEED, LAT_SPEED)


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
    new_starts = np.concatenate([[0], np.cumsum(sizes)])

    def descended(values: FloatArray) -> FloatArray:
        rows = np.empty((len(values), len(ancestors)))
        in_shares(lambda begin, end: _descend(begin, end, values, ancestors, which, new_starts, rows), len(which), 1e3)
        return rows

    cloud = mixture.cloud
    weights = np.stack([cloud.log_weight, cloud.log_raw_weight, cloud.log_component_weight])
    log_weight, log_raw_weight, log_component_weight = descended(weights)
    log_weight[which[component]] = -np.log(particles)
    cloud = ParticleCloud(
        state=descended(cloud.state),
        log_weight=log_weight,
        log_raw_weight=log_raw_weight,
        component=component,
        log_component_weight=log_component_weight,
        latents=descended(cloud.latents),
    )
    return replace(mixture, cloud=cloud), ancestors


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
    size = len(mixture.cloud) // len(mixture)
    covariance = np.zeros((len(chosen), len(REDRAWN), len(REDRAWN)))
    mean = component_moments(mixture).mean[list(REDRAWN)][:, chosen]
    old_state, old_log_weight, begins = mixture.cloud.state, mixture.cloud.log_weight, chosen * size

    def accumulate(begin: int, end: int) -> None:
        _accumulate_covariances(begin, end, old_state, old_log_weight, begins, size, mean, covariance)

    in_shares(accumulate, len(chosen), cost=size)
    widening = 1.0 + effective_size[chosen, None, None] ** (-2.0 / 9.0)
    widened = covariance * widening + 1e-9 * np.eye(len(REDRAWN))
    factor = np.asarray(np.linalg.cholesky(widened), dtype=np.float64)
    normal = standard_normals(rng, (len(chosen), len(REDRAWN), size))
    state, log_weight = old_state.copy(), old_log_weight.copy()

    def redraw(begin: int, end: int) -> None:
        _redraw(begin, end, state, log_weight, begins, mean, factor, normal)

    in_shares(redraw, len(chosen), cost=size)
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


@numba.njit(cache=True, fastmath=True, nogil=True)
def _accumulate_covariances(
    begin: int,
    end: int,
    state: FloatArray,
    log_weight: FloatArray,
    begins: IntArray,
    size: int,
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    """Write the weighted covariance of the redrawn state variables of components that begin at ``begins``."""
    weight = np.empty(size)
    weighted = np.empty(size)
    for c in range(begin, end):
        own = slice(begins[c], begins[c] + size)
        weight[:] = np.exp(log_weight[own])
        for i in range(len(REDRAWN)):
            first = state[REDRAWN[i], own]
            for n in range(size):
                weighted[n] = weight[n] * (first[n] - mean[i, c])
            for j in range(i + 1):
                second = state[REDRAWN[j], own]
                total = 0.0
                for n in range(size):
                    total += weighted[n] * (second[n] - mean[j, c])
                covariance[c, i, j] = covariance[c, j, i] = total


@numba.njit(cache=True, fastmath=True, nogil=True)
def _redraw(
    begin: int,
    end: int,
    state: FloatArray,
    log_weight: FloatArray,
    begins: IntArray,
    mean: FloatArray,
    factor: FloatArray,
    normal: Float32Array,
) -> None:
    """Write mean plus Cholesky factor times normal numbers (c, 4, size), and even weights."""
    size = normal.shape[2]
    for c in range(begin, end):
        own = slice(begins[c], begins[c] + size)
        log_weight[own] = -np.log(size)
        for i in range(len(REDRAWN)):
            drawn = state[REDRAWN[i], own]
            drawn[:] = mean[i, c]
            for j in range(i + 1):
                share, source = factor[c, i, j], normal[c, j]
                for n in range(size):
                    drawn[n] += share * source[n]
            if REDRAWN[i] == SPEED:
                for n in range(size):
                    drawn[n] = max(drawn[n], 0.0)


@numba.njit(cache=True, nogil=True)
def _descend(
    begin: int,
    end: int,
    values: FloatArray,
    ancestors: IntArray,
    is_resampled: npt.NDArray[np.bool_],
    starts: IntArray,
    descended: FloatArray,
) -> None:
    """Write the values of each particle's ancestor for the components from ``begin`` to ``end``."""
    for row in range(len(values)):
        for m in range(begin, end):
            own = descended[row, starts[m] : starts[m + 1]]
            if is_resampled[m]:
                forebears = ancestors[starts[m] : starts[m + 1]]
                for n in range(len(own)):
                    own[n] = values[row, forebears[n]]
            elif len(own):
                first = ancestors[starts[m]]
                own[:] = values[row, first : first + len(own)]
