"""The bulk normal numbers against the normal distribution."""

import numpy as np
import pytest
from scipy import stats

from mmpf.numerics.normals import standard_normals


@pytest.mark.parametrize("half", [0, 1], ids=["first of each pair", "second of each pair"])
def test_numbers_are_normal_in_the_middle_and_in_the_tails(half):
    drawn = np.split(standard_normals(np.random.default_rng(half), (400_000,)).astype(float), 2)[half]
    assert stats.kstest(drawn, "norm").pvalue > 0.001
    for bound in (2.0, 3.0, 4.0):
        expected = len(drawn) * stats.norm.sf(bound)
        for tail in (drawn > bound, drawn < -bound):
            assert tail.sum() == pytest.approx(expected, abs=4.5 * np.sqrt(expected))


def test_the_two_numbers_of_a_pair_are_independent():
    first, second = np.split(standard_normals(np.random.default_rng(3), (400_000,)).astype(float), 2)
    assert stats.kstest(np.arctan2(second, first) / (2.0 * np.pi) + 0.5, "uniform").pvalue > 0.001
    assert stats.kstest(0.5 * (first**2 + second**2), "expon").pvalue > 0.001


@pytest.mark.parametrize("shape", [(0,), (1,), (5,), (3, 7), (2, 0)])
def test_any_shape_is_filled(shape):
    drawn = standard_normals(np.random.default_rng(0), shape)
    assert drawn.shape == shape
    assert np.isfinite(drawn).all()
