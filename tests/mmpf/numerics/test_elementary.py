"""The project's own elementary functions against NumPy's."""

import numpy as np
import pytest

from mmpf.numerics import elementary

WIDE = np.concatenate([np.linspace(-707.0, 708.9, 20_001), np.linspace(-1.0, 1.0, 777), [0.0, -1e-300, 1e-17]])


def test_exponentials_are_numpys_to_the_last_digits_at_any_size():
    np.testing.assert_allclose(elementary.exp(WIDE), np.exp(WIDE), rtol=5e-16)
    assert elementary.exp(0.0) == 1.0


def test_logarithms_are_numpys_to_the_last_digits_at_any_size():
    x = np.concatenate([np.exp(WIDE), 1.0 + np.linspace(-1e-3, 1e-3, 999), [5e-324, 1e-310, 1.7e308]])
    np.testing.assert_allclose(elementary.log(x), np.log(x), rtol=5e-16, atol=1e-18)


def test_what_has_no_finite_result_is_what_numpy_says():
    x = np.array([np.nan, -np.inf, np.inf, -800.0, 800.0])
    np.testing.assert_array_equal(elementary.exp(x), [np.nan, 0.0, np.inf, 0.0, np.inf])
    x = np.array([np.nan, -np.inf, np.inf, -1.0, 0.0, -0.0])
    np.testing.assert_array_equal(elementary.log(x), [np.nan, np.nan, np.inf, np.nan, -np.inf, -np.inf])


@pytest.mark.parametrize("name", ["exp", "log", "expm1", "cos", "sin"])
def test_shapes_types_and_places_to_write_are_as_numpys(name):
    x = np.random.default_rng(1).uniform(0.1, 5.0, (3, 4, 5))
    mine, theirs = getattr(elementary, name), getattr(np, name)
    np.testing.assert_allclose(mine(x.T), theirs(x.T), rtol=1e-14)
    assert np.isclose(mine(0.25), theirs(0.25), rtol=1e-14)


def test_results_are_written_where_they_are_wanted_in_the_type_of_that_place():
    x = np.random.default_rng(1).uniform(0.1, 5.0, 700).astype(np.float32)
    for mine, theirs in ((elementary.exp, np.exp), (elementary.log, np.log)):
        written = x.copy()
        mine(written, out=written)
        np.testing.assert_allclose(written, theirs(x), rtol=1e-5, atol=1e-6)
