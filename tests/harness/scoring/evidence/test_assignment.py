import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.scoring.evidence.assignment import best_assignment


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), lefts=st.integers(1, 5), rights=st.integers(1, 5), density=st.floats(0, 1))
def test_the_chosen_pairs_have_the_greatest_sum_that_any_one_to_one_choice_has(seed, lefts, rights, density):
    rng = np.random.default_rng(seed)
    left, right = np.nonzero(rng.random((lefts, rights)) < density)
    order = rng.permutation(len(left))
    left, right = left[order], right[order]
    score = rng.uniform(0.01, 1.0, len(left))
    chosen = best_assignment(left, right, score)
    assert len(set(left[chosen])) == chosen.sum() == len(set(right[chosen])), "one to one"
    assert score[chosen].sum() == pytest.approx(best_sum(left, right, score, lefts, rights))


def test_no_pairs_give_no_assignment():
    none = np.zeros(0, dtype=np.int64)
    assert len(best_assignment(none, none, np.zeros(0))) == 0


def best_sum(left, right, score, lefts, rights):
    """Try every way to give each left item a right one or none."""
    table = np.zeros((lefts, rights + lefts))
    table[left, right] = score
    return max(
        sum(table[row, column] for row, column in enumerate(columns))
        for columns in itertools.permutations(range(rights + lefts), lefts)
    )
