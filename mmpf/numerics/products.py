"""Products of small matrices that give the same bytes with any linear algebra library and number of threads."""

import numpy as np

from mmpf.numerics.arrays import Float32Array
from mmpf.numerics.kernels import kernel, part_of_kernel


def product(matrix: Float32Array, columns: Float32Array) -> Float32Array:
    """Return ``matrix @ columns``: shapes (k, e) and (e, n) make (k, n)."""
    result = np.empty((len(matrix), columns.shape[1]), dtype=np.float32)
    _write_product(np.ascontiguousarray(matrix), np.ascontiguousarray(columns), result)
    return result


@kernel(fastmath=True)
def _write_product(matrix: Float32Array, columns: Float32Array, result: Float32Array) -> None:
    multiply(matrix, columns, result)


@part_of_kernel(fastmath=True)
def multiply(matrix: Float32Array, columns: Float32Array, result: Float32Array) -> None:
    """Write ``matrix @ columns``, shapes (k, e) and (e, n), into a contiguous array (k, n).

    Four rows of the result take in four rows of the columns at once: these stay in registers.
    """
    last, end = len(matrix) - 1, len(columns) - 1
    factor = np.zeros((4, 4 * (end // 4 + 1)), dtype=np.float32)
    spare = np.empty((3, columns.shape[1]), dtype=np.float32)
    for k in range(0, last + 1, 4):
        one, two = result[k], result[k + 1] if k + 1 <= last else spare[0]
        three, four = result[k + 2] if k + 2 <= last else spare[1], result[k + 3] if k + 3 <= last else spare[2]
        one[:], two[:], three[:], four[:] = np.float32(0.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
        for row in range(4):
            for e in range(end + 1):
                factor[row, e] = matrix[min(k + row, last), e]
        for e in range(0, end + 1, 4):
            a, b, c, d = factor[0, e], factor[0, e + 1], factor[0, e + 2], factor[0, e + 3]
            f, g, h, i = factor[1, e], factor[1, e + 1], factor[1, e + 2], factor[1, e + 3]
            j, m, o, p = factor[2, e], factor[2, e + 1], factor[2, e + 2], factor[2, e + 3]
            q, r, s, t = factor[3, e], factor[3, e + 1], factor[3, e + 2], factor[3, e + 3]
            first, second = columns[e], columns[min(e + 1, end)]
            third, fourth = columns[min(e + 2, end)], columns[min(e + 3, end)]
            for n in range(len(one)):
                w, x, y, z = first[n], second[n], third[n], fourth[n]
                one[n] += (a * w + b * x) + (c * y + d * z)
                two[n] += (f * w + g * x) + (h * y + i * z)
                three[n] += (j * w + m * x) + (o * y + p * z)
                four[n] += (q * w + r * x) + (s * y + t * z)
