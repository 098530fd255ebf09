"""Compiled loops of the conditional Gaussian mixture: expanding inputs, picking components, drawing outputs."""

from __future__ import annotations

import numpy as np
from numba import njit

from mmpf.motion.conditional_gmm import Float32Array
from mmpf.road import FloatArray

NEGLIGIBLE_LOG_WEIGHT = -16.0


@njit(cache=True, fastmath=True)
def expand32(x: FloatArray) -> Float32Array:
    """Return ``[1, x, x_i x_j (i <= j)]`` in single precision for inputs of shape (n, p)."""
    n, p = x.shape
    expanded = np.empty((n, 1 + p + p * (p + 1) // 2), dtype=np.float32)
    for row in range(n):
        expanded[row, 0] = 1.0
        column = 1 + p
        for i in range(p):
            expanded[row, 1 + i] = x[row, i]
            for j in range(i, p):
                expanded[row, column] = x[row, i] * x[row, j]
                column += 1
    return expanded


@njit(cache=True, fastmath=True)
def pick_and_draw(
    logits: Float32Array,
    uniform: Float32Array,
    normal: FloatArray,
    x: FloatArray,
    bias: FloatArray,
    slope: FloatArray,
    noise_factor: FloatArray,
) -> FloatArray:
    """Pick each row's component by its log-weights and draw from that component's conditional Gaussian.

    Args:
        logits: Log-weights up to a constant per row, shape (n, k).
        uniform: Uniform draws, shape (n,).
        normal: Standard normal draws, shape (n, q).
        x: Inputs, shape (n, p).
        bias: Conditional means at zero, shape (k, q).
        slope: Slopes of the conditional means, shape (k, q, p).
        noise_factor: Cholesky factors of the conditional covariances, shape (k, q, q).

    Returns:
        Outputs, shape (n, q).
    """
    n, k = logits.shape
    q, p = slope.shape[1], slope.shape[2]
    drawn = np.empty((n, q))
    part = np.empty(k, dtype=np.float32)
    for row in range(n):
        _weigh(logits[row], part)
        threshold = uniform[row] * part.sum()
        picked = 0
        passed = part[0]
        while picked < k - 1 and passed <= threshold:
            picked += 1
            passed += part[picked]
        for output in range(q):
            value = bias[picked, output]
            for i in range(p):
                value += slope[picked, output, i] * x[row, i]
            for j in range(output + 1):
                value += noise_factor[picked, output, j] * normal[row, j]
            drawn[row, output] = value
    return drawn


@njit(cache=True, fastmath=True)
def _weigh(logits: Float32Array, part: Float32Array) -> None:
    """Write the exponentials of one row's logits below their maximum; those below exp(-16) become zero.

    ``exp(t) = exp(t / 32) ** 32`` with a polynomial for the root: unlike the library's exponential, the compiler turns
    it into vector instructions. The relative error is below 1e-6 for weights that matter.
    """
    top = logits[0]
    for component in range(1, len(logits)):
        top = max(top, logits[component])
    for component in range(len(logits)):
        t = max(logits[component] - top, np.float32(NEGLIGIBLE_LOG_WEIGHT)) * np.float32(1.0 / 32.0)
        root = np.float32(1.0 / 120.0)
        root = root * t + np.float32(1.0 / 24.0)
        root = root * t + np.float32(1.0 / 6.0)
        root = root * t + np.float32(0.5)
        root = root * t + np.float32(1.0)
        root = root * t + np.float32(1.0)
        root *= root
        root *= root
        root *= root
        root *= root
        root *= root
        part[component] = root if t > np.float32(NEGLIGIBLE_LOG_WEIGHT / 32.0) else np.float32(0.0)
