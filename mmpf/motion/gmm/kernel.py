"""Compiled loops of the conditional Gaussian mixture: expand inputs, select components, draw outputs.

Rows are worked on in blocks that stay in the processor's cache, and within a block all rows side by side, so that the
compiler turns every loop into vector instructions.
"""

from typing import NamedTuple

import numpy as np

from mmpf.numerics.arrays import Float32Array, FloatArray, Int32Array
from mmpf.numerics.kernels import kernel, part_of_kernel
from mmpf.numerics.products import multiply


class Scaling(NamedTuple):
    """Bounds and scales of p inputs and q outputs; the mixture itself knows standardised numbers only.

    Attributes:
        input_mean: Shift of the inputs, shape (p,).
        input_scale: Scale of the inputs, shape (p,).
        output_mean: Shift of the outputs, shape (q,).
        output_scale: Scale of the outputs, shape (q,).
        input_low: Least inputs of the training data, shape (p,); smaller ones are taken for these.
        input_high: Greatest inputs of the training data, shape (p,).
    """

    input_mean: FloatArray
    input_scale: FloatArray
    output_mean: FloatArray
    output_scale: FloatArray
    input_low: FloatArray
    input_high: FloatArray


class Conditional(NamedTuple):
    """The parameters of a conditional mixture of k components over p inputs and q outputs.

    Attributes:
        logit_matrix: Coefficients of the log-weights over ``[1, x, x_i x_j (i <= j)]``, shape (k, 1 + p + p(p+1)/2).
        bias: Conditional means at zero, shape (q, k).
        slope: Slopes of the conditional means, shape (q, p, k).
        noise_factor: Cholesky factors of the conditional covariances, shape (q, q, k).
    """

    logit_matrix: Float32Array
    bias: FloatArray
    slope: FloatArray
    noise_factor: FloatArray


NEGLIGIBLE_LOG_WEIGHT = -16.0
# A block of all components' log-weights stays in the processor's second cache.
BLOCK = 256


@kernel(fastmath=True)
def draw_outputs(
    begin: int,
    end: int,
    x: FloatArray,
    scaling: Scaling,
    conditional: Conditional,
    uniform: Float32Array,
    normal: Float32Array,
    drawn: FloatArray,
) -> None:
    """Pick each column's component by its log-weights and draw from that component's conditional Gaussian.

    Args:
        begin: First column, and
        end: the one after the last that is drawn; multiples of ``BLOCK``, or n.
        x: Inputs, shape (p, n).
        scaling: Bounds and scales.
        conditional: The mixture.
        uniform: Uniform draws, shape (n,).
        normal: Standard normal draws, shape (q, n).
        drawn: Outputs, shape (q, n), which are written.
    """
    logit_matrix = conditional.logit_matrix
    expanded = np.zeros((logit_matrix.shape[1], BLOCK), dtype=np.float32)
    logits = np.empty((logit_matrix.shape[0], BLOCK), dtype=np.float32)
    top = np.empty(BLOCK, dtype=np.float32)
    component = np.zeros(BLOCK, dtype=np.int32)
    for first in range(begin, end, BLOCK):
        block = slice(first, min(first + BLOCK, end))
        _expand(x[:, block], scaling, expanded)
        multiply(logit_matrix, expanded, logits)
        _pick(logits, uniform[block], top, component)
        _draw(component, expanded, normal[:, block], scaling, conditional, drawn[:, block])


@part_of_kernel(fastmath=True)
def _expand(x: FloatArray, scaling: Scaling, expanded: Float32Array) -> None:
    """Write ``[1, x, x_i x_j (i <= j)]`` of standardised columns (p, r) as the first r columns of ``expanded``."""
    p, rows = x.shape
    for row in range(rows):
        expanded[0, row] = 1.0
    for i in range(p):
        values, out = x[i], expanded[1 + i]
        low, high = scaling.input_low[i], scaling.input_high[i]
        mean, per_scale = scaling.input_mean[i], 1.0 / scaling.input_scale[i]
        for row in range(rows):
            out[row] = (min(max(values[row], low), high) - mean) * per_scale
    column = 1 + p
    for i in range(p):
        for j in range(i, p):
            first, second, product = expanded[1 + i], expanded[1 + j], expanded[column]
            for row in range(rows):
                product[row] = first[row] * second[row]
            column += 1


@part_of_kernel(fastmath=True)
def _pick(logits: Float32Array, uniform: Float32Array, top: Float32Array, component: Int32Array) -> None:
    """Draw a component for each of the first columns of ``logits``, shape (k, BLOCK), which is overwritten.

    A weight is ``exp(t) = exp(t / 32) ** 32`` with a polynomial for the root: unlike the library's exponential, the
    compiler turns it into vector instructions. The relative error is below 1e-6 for weights that matter; those below
    exp(-16) of the largest count as zero.
    """
    rows = len(uniform)
    for row in range(BLOCK):
        top[row] = logits[0, row]
        component[row] = 0
    for k in range(1, len(logits)):
        one = logits[k]
        for row in range(BLOCK):
            top[row] = max(top[row], one[row])
    total = np.zeros(BLOCK, dtype=np.float32)
    for k in range(len(logits)):
        one = logits[k]
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
            total[row] += root if t > np.float32(NEGLIGIBLE_LOG_WEIGHT / 32.0) else np.float32(0.0)
            one[row] = total[row]
    for row in range(rows):
        top[row] = uniform[row] * total[row]
    for k in range(len(logits) - 1):
        one = logits[k]
        for row in range(rows):
            component[row] += one[row] <= top[row]


@part_of_kernel(fastmath=True)
def _draw(
    component: Int32Array,
    expanded: Float32Array,
    normal: Float32Array,
    scaling: Scaling,
    conditional: Conditional,
    drawn: FloatArray,
) -> None:
    """Draw from the conditional Gaussians of the picked components, output by output, for each column of ``drawn``."""
    for output in range(len(drawn)):
        values = drawn[output]
        bias = conditional.bias[output]
        for row in range(len(values)):
            values[row] = bias[component[row]]
        for i in range(conditional.slope.shape[1]):
            slope, one = conditional.slope[output, i], expanded[1 + i]
            for row in range(len(values)):
                values[row] += slope[component[row]] * one[row]
        for j in range(output + 1):
            factor, noise = conditional.noise_factor[output, j], normal[j]
            for row in range(len(values)):
                values[row] += factor[component[row]] * noise[row]
        mean, scale = scaling.output_mean[output], scaling.output_scale[output]
        for row in range(len(values)):
            values[row] = mean + scale * values[row]
