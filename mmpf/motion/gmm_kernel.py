"""Compiled loops of the conditional Gaussian mixture: expanding inputs, picking components, drawing outputs.

Rows are worked on in blocks that stay in the processor's cache, and within a block all rows side by side, so that the
compiler turns every loop into vector instructions.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from mmpf.road import FloatArray

Float32Array = npt.NDArray[np.float32]
Int32Array = npt.NDArray[np.int32]

NEGLIGIBLE_LOG_WEIGHT = -16.0
# Small enough that no linear algebra library deals the product out to threads, which costs more than it saves.
BLOCK = 128


@njit(cache=True, fastmath=True)
def draw_outputs(
    x: FloatArray,
    logit_matrix: Float32Array,
    uniform: Float32Array,
    normal: Float32Array,
    bias: FloatArray,
    slope: FloatArray,
    noise_factor: FloatArray,
) -> FloatArray:
    """Pick each row's component by its log-weights and draw from that component's conditional Gaussian.

    Args:
        x: Inputs, shape (n, p).
        logit_matrix: Coefficients of the log-weights over ``[1, x, x_i x_j (i <= j)]``, shape (k, 1 + p + p(p+1)/2).
        uniform: Uniform draws, shape (n,).
        normal: Standard normal draws, shape (n, q).
        bias: Conditional means at zero, shape (k, q).
        slope: Slopes of the conditional means, shape (k, q, p).
        noise_factor: Cholesky factors of the conditional covariances, shape (k, q, q).

    Returns:
        Outputs, shape (n, q).
    """
    n, p = x.shape
    q = slope.shape[1]
    drawn = np.empty((n, q))
    expanded = np.zeros((logit_matrix.shape[1], BLOCK), dtype=np.float32)
    logits = np.empty((logit_matrix.shape[0], BLOCK), dtype=np.float32)
    top = np.empty(BLOCK, dtype=np.float32)
    component = np.zeros(BLOCK, dtype=np.int32)
    for begin in range(0, n, BLOCK):
        rows = min(BLOCK, n - begin)
        _expand(x[begin : begin + rows], expanded)
        np.dot(logit_matrix, expanded, logits)
        _pick(logits, uniform[begin : begin + rows], top, component)
        for row in range(rows):
            picked = component[row]
            for output in range(q):
                value = bias[picked, output]
                for i in range(p):
                    value += slope[picked, output, i] * x[begin + row, i]
                for j in range(output + 1):
                    value += noise_factor[picked, output, j] * normal[begin + row, j]
                drawn[begin + row, output] = value
    return drawn


@njit(cache=True)
def standardise(x: FloatArray, low: FloatArray, high: FloatArray, mean: FloatArray, scale: FloatArray) -> FloatArray:
    """Return inputs of shape (n, p) held between bounds, less their mean and over their scale, each of shape (p,)."""
    n, p = x.shape
    standardised = np.empty((n, p))
    for row in range(n):
        for i in range(p):
            held = low[i] if x[row, i] < low[i] else high[i] if x[row, i] > high[i] else x[row, i]
            standardised[row, i] = (held - mean[i]) / scale[i]
    return standardised


@njit(cache=True, fastmath=True)
def _expand(x: FloatArray, expanded: Float32Array) -> None:
    """Write ``[1, x, x_i x_j (i <= j)]`` of rows (r, p) as the first r columns of ``expanded``."""
    rows, p = x.shape
    for row in range(rows):
        expanded[0, row] = 1.0
        for i in range(p):
            expanded[1 + i, row] = x[row, i]
    column = 1 + p
    for i in range(p):
        for j in range(i, p):
            first, second, product = expanded[1 + i], expanded[1 + j], expanded[column]
            for row in range(rows):
                product[row] = first[row] * second[row]
            column += 1


@njit(cache=True, fastmath=True)
def _pick(logits: Float32Array, uniform: Float32Array, top: Float32Array, component: Int32Array) -> None:
    """Draw a component for each of the first columns of ``logits``, shape (k, BLOCK), which is overwritten.

    A weight is ``exp(t) = exp(t / 32) ** 32`` with a polynomial for the root: unlike the library's exponential, the
    compiler turns it into vector instructions. The relative error is below 1e-6 for weights that matter; those below
    exp(-16) of the largest count as zero.
    """
    rows = len(uniform)
    top[:] = logits[0]
    for k in range(1, len(logits)):
        one = logits[k]
        for row in range(BLOCK):
            top[row] = max(top[row], one[row])
    for k in range(len(logits)):
        one, passed = logits[k], logits[max(k - 1, 0)]
        for row in range(BLOCK):
            t = max(one[row] - top[row], np.float32(NEGLIGIBLE_LOG_WEIGHT)) * np.float32(1.0 / 32.0)
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
            one[row] = root if t > np.float32(NEGLIGIBLE_LOG_WEIGHT / 32.0) else np.float32(0.0)
        if k:
            for row in range(BLOCK):
                one[row] += passed[row]
    total = logits[-1]
    component[:] = 0
    for row in range(rows):
        top[row] = uniform[row] * total[row]
    for k in range(len(logits) - 1):
        one = logits[k]
        for row in range(rows):
            component[row] += one[row] <= top[row]
