"""The compiled matrix product against NumPy's."""

import numpy as np
import pytest

from mmpf.numerics.products import product


@pytest.mark.parametrize(
    ("k", "e", "n"), [(1, 1, 1), (28, 28, 128), (60, 120, 128), (7, 21, 5), (1, 32, 100), (3, 9, 0)]
)
def test_a_product_is_the_sum_of_products_to_single_precision(k, e, n):
    rng = np.random.default_rng(k + e + n)
    matrix, columns = (rng.normal(size=shape).astype(np.float32) for shape in ((k, e), (e, n)))
    exact = matrix.astype(np.float64) @ columns.astype(np.float64)
    bound = 1e-6 * (np.abs(matrix).astype(np.float64) @ np.abs(columns))
    assert (np.abs(product(matrix, columns) - exact) <= bound).all()
    np.testing.assert_array_equal(product(np.asfortranarray(matrix), columns), product(matrix, columns))
