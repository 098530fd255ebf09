"""The compiled matrix product against NumPy's."""

import numpy as np
import pytest

from mmpf.numerics.products import factors, inverses, product


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


def test_factors_and_inverses_are_numpys_and_a_matrix_without_a_factor_gives_nan():
    root = np.random.default_rng(2).normal(size=(5, 6, 6))
    matrices = root @ root.transpose(0, 2, 1) + 0.1 * np.eye(6)
    np.testing.assert_allclose(factors(matrices), np.linalg.cholesky(matrices), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(inverses(factors(matrices)), np.linalg.inv(matrices), rtol=1e-7, atol=1e-9)
    assert np.isnan(factors(-np.eye(2)[None])).any()
