"""Products of small matrices that give the same bytes with any linear algebra library and number of threads."""

from __future__ import annotations

import numpy as np

from mmpf.numerics.arrays import Float32Array
from mmpf.numerics.kernels import kernel


def product(matrix: Float32Array, columns: Float32Array) -> Float32Array:
    """Return ``matrix @ columns``: shapes (k, e) and (e, n) make (k, n)."""
    result = np.empty((len(matrix), columns.shape[1]), dtype=np.float32)
    multiply(np.ascontiguousarray(matrix), np.ascontiguousarray(columns), result)
    return result


@kernel(fastmath=True)
def multiply(matrix: Float32Array, columns: Float32Array, result: Float32Array) -> None:
    """Write ``matrix @ columns``, shapes (k, e) and (e, n), into a contiguous array (k, n).

    Two rows of the result take in four rows of the columns at once: these stay in registers.
    """
    last, end = len(matrix) - 1, len(columns) - 1
    factor = np.zeros((2, 4 * (end // 4 + 1)), dtype=np.float32)
    spare = np.empty(columns.shape[1], dtype=np.float32)
    for k in range(0, last + 1, 2):
        out, other = result[k], result[k + 1] if k < last else spare
        for e in range(end + 1):
            factor[0, e], factor[1, e] = matrix[k, e], matrix[min(k + 1, last), e]
        out[:], other[:] = np.float32(0.0), np.float32(0.0)
        for e in range(0, end + 1, 4):
            a, b, c, d = factor[0, e], factor[0, e + 1], factor[0, e + 2], factor[0, e + 3]
            p, q, r, s = factor[1, e], factor[1, e + 1], factor[1, e + 2], factor[1, e + 3]
            first, second = columns[e], columns[min(e + 1, end)]
            third, fourth = columns[min(e + 2, end)], columns[min(e + 3, end)]
            for n in range(len(out)):
                w, x, y, z = first[n], second[n], third[n], fourth[n]
                out[n] += (a * w + b * x) + (c * y + d * z)
                other[n] += (p * w + q * x) + (r * y + s * z)
