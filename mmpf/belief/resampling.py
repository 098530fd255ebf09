"""Systematic resampling within components, plain or smoothed by a kernel."""

from dataclasses import replace

import numpy as np

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import state_moments
from mmpf.motion.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import BoolArray, Float32Array, FloatArray, IntArray
from mmpf.numerics.kernels import kernel, part_of_kernel
from mmpf.numerics.normals import standard_normals
from mmpf.numerics.threads import in_shares

SMOOTHED = (LON, LAT, SPEED, LAT_SPEED, ACCEL, LAT_ACCEL)
SMALLEST_VARIANCE = 1e-9


def resample(mixture: Mixture, which: BoolArray, particles: int, rng: np.random.Generator) -> tuple[Mixture, IntArray]:
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
    cloud.log_weight[which[component]] = -np.log(particles)
    return replace(mixture, cloud=cloud), ancestors


def resample_smoothly(
    mixture: Mixture,
    which: BoolArray,
    particles: int,
    kernel_width: FloatArray,
    rng: np.random.Generator,
    weight: FloatArray | None = None,
) -> Mixture:
    """Resample the chosen components in place and smooth their particles, else copies of few ancestors.

    A particle is drawn towards the component's mean by ``sqrt(1 - h^2)`` and then moved by ``h`` times a draw from the
    component's covariance (Liu and West 2001), so that mean and covariance stay as they were, and what the latents
    have to do with the state nearly so. A width of one draws states from the weighted Gaussian.

    Args:
        mixture: The belief; weights sum to one in each component. Its arrays are rewritten.
        which: Components to resample, shape (m,).
        particles: Particles that each of them has.
        kernel_width: h of each component, from zero to one, shape (m,).
        rng: Source of randomness.
        weight: The particles' weights where they are known already, which are rewritten too, shape (n,).

    Returns:
        The belief after resampling, which is the same one.

    Raises:
        ValueError: One of the chosen has another number of particles.
    """
    chosen = np.flatnonzero(which)
    starts = mixture.starts
    begins = starts[chosen]
    if (np.diff(starts)[chosen] != particles).any():
        raise ValueError(f"each component that is resampled in place must have {particles} particles")
    weight = np.exp(mixture.cloud.log_weight) if weight is None else weight
    mean = state_moments(mixture, chosen, weight)[0][list(SMOOTHED)]
    factor = kernel_width[chosen, None, None] * _covariance_factors(mixture, chosen, mean)
    kept = np.sqrt(1.0 - kernel_width[chosen] ** 2)
    offsets = rng.uniform(size=len(mixture))[chosen]
    if len(chosen) == 0:
        return mixture
    normal = standard_normals(rng, (len(chosen), len(SMOOTHED), particles))
    cloud = mixture.cloud
    rows, even = (cloud.state, cloud.latents, cloud.log_raw_weight[None]), float(-np.log(particles))

    def smooth(begin: int, end: int) -> None:
        _resample_in_place(
            begin, end, begins, offsets, weight, rows, cloud.log_weight, even, mean, kept, factor, normal
        )

    in_shares(smooth, len(chosen), cost=particles)
    for begin in begins:
        weight[begin : begin + particles] = np.exp(even)
    return mixture


def _covariance_factors(mixture: Mixture, chosen: IntArray, mean: FloatArray) -> FloatArray:
    """Return the Cholesky factors of the chosen components' covariances, shape (c, 6, 6)."""
    covariance = np.zeros((len(chosen), len(SMOOTHED), len(SMOOTHED)))
    state, log_weight, starts = mixture.cloud.state, mixture.cloud.log_weight, mixture.starts

    def accumulate(begin: int, end: int) -> None:
        _accumulate_covariances(begin, end, state, log_weight, starts, chosen, mean, covariance)

    in_shares(accumulate, len(chosen), cost=len(state[0]) / max(len(mixture), 1))
    return np.asarray(np.linalg.cholesky(covariance + SMALLEST_VARIANCE * np.eye(len(SMOOTHED))), dtype=np.float64)


@kernel()
def _systematic_ancestors(
    weight: FloatArray,
    starts: IntArray,
    which: BoolArray,
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
        _draw_ancestors(begin, end, weight, offsets[m], ancestors[out : out + particles])
        out += particles


@part_of_kernel()
def _draw_ancestors(begin: int, end: int, weight: FloatArray, offset: float, ancestors: IntArray) -> None:
    """Write the ancestors, numbers from ``begin`` to ``end``, of a component's new particles."""
    total = 0.0
    for n in range(begin, end):
        total += weight[n]
    cumulative = weight[begin]
    n = begin
    for k in range(len(ancestors)):
        target = (k + offset) / len(ancestors) * total
        while cumulative < target and n < end - 1:
            n += 1
            cumulative += weight[n]
        ancestors[k] = n


@kernel()
def _resample_in_place(
    begin: int,
    end: int,
    begins: IntArray,
    offsets: FloatArray,
    weight: FloatArray,
    rows: tuple[FloatArray, FloatArray, FloatArray],
    log_weight: FloatArray,
    even: float,
    mean: FloatArray,
    kept: FloatArray,
    factor: FloatArray,
    normal: Float32Array,
) -> None:
    """Rewrite the components that begin at ``begins`` by their ancestors, of even weights, and smooth them."""
    size = normal.shape[2]
    ancestors, descended = np.empty(size, dtype=np.int64), np.empty(size)
    for c in range(begin, end):
        first, after = begins[c], begins[c] + size
        _draw_ancestors(first, after, weight, offsets[c], ancestors)
        for block in rows:
            for row in range(len(block)):
                for k in range(size):
                    descended[k] = block[row, ancestors[k]]
                # An assignment to the slice would have the compiler make ready its message for shapes that differ.
                for k in range(size):
                    block[row, first + k] = descended[k]
        for k in range(size):
            log_weight[first + k] = even
    _smooth(begin, end, rows[0], begins, mean, kept, factor, normal)


@kernel(fastmath=True)
def _accumulate_covariances(
    begin: int,
    end: int,
    state: FloatArray,
    log_weight: FloatArray,
    starts: IntArray,
    chosen: IntArray,
    mean: FloatArray,
    covariance: FloatArray,
) -> None:
    """Write the weighted covariance of the smoothed state variables of the chosen components."""
    for c in range(begin, end):
        own = slice(starts[chosen[c]], starts[chosen[c] + 1])
        weight = np.exp(log_weight[own])
        weighted = np.empty_like(weight)
        for i in range(len(SMOOTHED)):
            first = state[SMOOTHED[i], own]
            for n in range(len(weight)):
                weighted[n] = weight[n] * (first[n] - mean[i, c])
            for j in range(i + 1):
                second = state[SMOOTHED[j], own]
                total = 0.0
                for n in range(len(weight)):
                    total += weighted[n] * (second[n] - mean[j, c])
                covariance[c, i, j] = covariance[c, j, i] = total


@part_of_kernel(fastmath=True)
def _smooth(
    begin: int,
    end: int,
    state: FloatArray,
    begins: IntArray,
    mean: FloatArray,
    kept: FloatArray,
    factor: FloatArray,
    normal: Float32Array,
) -> None:
    """Move particles towards the mean and add the factor times normal numbers (c, 6, size); speeds stay nonnegative."""
    size = normal.shape[2]
    for c in range(begin, end):
        own = slice(begins[c], begins[c] + size)
        for i in range(len(SMOOTHED)):
            values = state[SMOOTHED[i], own]
            centre = (1.0 - kept[c]) * mean[i, c]
            for n in range(size):
                values[n] = centre + kept[c] * values[n]
            for j in range(i + 1):
                share, source = factor[c, i, j], normal[c, j]
                for n in range(size):
                    values[n] += share * source[n]
            if SMOOTHED[i] == SPEED:
                for n in range(size):
                    values[n] = max(values[n], 0.0)
