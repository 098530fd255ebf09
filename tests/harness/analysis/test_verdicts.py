"""Verdicts: three words, what each needs, their false alarms and their power."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.analysis.arms import Arms, Layout, measure
from harness.analysis.verdicts import (
    BETTER,
    NO_WORSE,
    PRIMARY,
    UNDECIDED,
    UNTESTED,
    WORSE,
    Rules,
    Verdict,
    compared_quantities,
    holm,
    judge,
)
from harness.scoring.metrics.quantity import Quantity

ERROR, SCORE = Quantity("error", "error, m"), Quantity("score", "score, %", higher_is_better=True)
RULES = Rules(primary=("error", "score"))


def arms(quantity: Quantity, a: np.ndarray, b: np.ndarray, label: str = "x") -> Arms:
    """Return paired arms of as many seeds as there are values."""
    one, each = np.zeros(len(a), dtype=np.int64), np.arange(len(a))
    return Arms(label, quantity, a, b, Layout(True, (one, one), (each, each)))


def judged(*given: Arms, rules: Rules = RULES) -> list[Verdict]:
    return judge([measure(each) for each in given], rules)


def test_holm_multiplies_by_the_number_of_hypotheses_not_yet_rejected():
    # The example of Holm's procedure: 0.01 * 4, 0.02 * 3, 0.03 * 2, and never less than the one before.
    np.testing.assert_allclose(holm(np.array([0.03, 0.01, 0.9, 0.02])), [0.06, 0.04, 0.9, 0.06])


def test_what_was_not_tested_costs_the_others_nothing():
    np.testing.assert_allclose(holm(np.array([np.nan, 0.02, np.nan])), [np.nan, 0.02, np.nan])


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12))
def test_corrected_p_values_keep_their_order_and_never_shrink(values):
    p = np.array(values)
    corrected = holm(p)
    assert (corrected >= p).all()
    assert (corrected <= 1.0).all()
    assert (np.diff(corrected[np.argsort(p, kind="stable")]) >= 0.0).all()


WOBBLE = np.array([-0.2, 0.1, 0.3, -0.1, 0.2, -0.3, 0.15, -0.15])


@pytest.mark.parametrize(
    ("shift", "word"), [(6.0, WORSE), (3.0, WORSE), (0.5, NO_WORSE), (0.0, NO_WORSE), (-3.0, BETTER)]
)
def test_the_interval_beside_the_tolerance_decides(shift, word):
    a = np.full(8, 100.0)
    (verdict,) = judged(arms(ERROR, a, a + shift + WOBBLE))
    assert (verdict.verdict, verdict.regression) == (word, word == WORSE)


def test_the_direction_of_a_metric_decides_between_better_and_worse():
    a = np.full(8, 100.0)
    error, score = judged(arms(ERROR, a, a + 9.0 + WOBBLE), arms(SCORE, a, a + 9.0 + WOBBLE))
    assert (error.verdict, score.verdict) == (WORSE, BETTER)


def test_wide_intervals_leave_it_undecided_and_say_how_many_seeds_would_not():
    a = np.full(4, 100.0)
    noise = 20.0 * WOBBLE[:4]
    (verdict,) = judged(arms(ERROR, a, a + 2.5 + noise))
    assert verdict.verdict == UNDECIDED
    assert verdict.more_units is not None
    assert verdict.more_units > 4


def test_a_difference_within_the_tolerance_is_not_worse_however_sure():
    a = np.full(8, 100.0)
    (verdict,) = judged(arms(ERROR, a, a + 1.0 + 0.01 * WOBBLE))
    assert (verdict.p < 0.01, verdict.verdict) == (True, NO_WORSE)
    (strict,) = judged(arms(ERROR, a, a + 1.0 + 0.01 * WOBBLE), rules=Rules(0.005, primary=("error",)))
    assert strict.verdict == WORSE


def test_equal_runs_are_no_worse_however_few():
    for seeds in (1, 2, 8):
        values = np.arange(seeds) + 1.0
        assert [verdict.verdict for verdict in judged(arms(ERROR, values, values), arms(SCORE, values, values))] == [
            NO_WORSE,
            NO_WORSE,
        ]


def test_one_seed_decides_nothing_however_large_the_difference():
    (verdict,) = judged(arms(ERROR, np.array([1.0]), np.array([50.0])))
    assert (verdict.verdict, verdict.wanting) == (UNDECIDED, "too few to tell")


def test_differences_that_are_all_equal_pass_for_certain_only_where_there_are_many():
    """A score of 100 % in every run does not show that it stays so; the other metric shows that runs differ."""
    full = np.full(8, 100.0)
    for seeds, word in ((3, UNDECIDED), (8, NO_WORSE)):
        wobble = np.full(seeds, 10.0) + WOBBLE[:seeds]
        score, _ = judged(arms(SCORE, full[:seeds], full[:seeds]), arms(ERROR, wobble, wobble[::-1].copy()))
        assert score.verdict == word


def test_a_score_that_falls_from_all_to_nothing_in_each_of_three_runs_is_worse():
    full, wobble = np.full(3, 100.0), np.full(3, 10.0) + WOBBLE[:3]
    score, _ = judged(arms(SCORE, full, np.zeros(3)), arms(ERROR, wobble, wobble[::-1].copy()))
    assert score.verdict == WORSE


def test_pairs_with_a_missing_half_are_left_out_and_too_many_of_them_leave_it_undecided():
    a = np.full(8, 100.0)
    b = np.where(np.arange(8) < 2, np.nan, a + WOBBLE)
    (verdict,) = judged(arms(ERROR, a, b))
    assert (verdict.pairs, verdict.verdict) == (6, UNDECIDED)
    assert verdict.wanting == "b lacks 2 of the 8 values that a has"


def test_metrics_that_were_not_named_beforehand_are_described_and_cost_the_others_nothing():
    a = np.full(8, 100.0)
    many = [arms(Quantity(f"m{place}", "m"), a, a + 50.0 + WOBBLE) for place in range(40)]
    alone, *_ = judged(arms(ERROR, a, a + 1.5 + WOBBLE))
    first, *others = judged(arms(ERROR, a, a + 1.5 + WOBBLE), *many)
    assert first == alone
    assert {verdict.verdict for verdict in others} == {UNTESTED}
    assert all(verdict.ci95[0] > 49.0 for verdict in others)


def simulated(rng: np.random.Generator, seeds: int, planted: float = 1.0, within: float = 0.04) -> list[Arms]:
    """Draw both arms of the metrics that are judged; seeds move all of them together, as dense or jammed traffic does.

    Args:
        rng: Source of all.
        seeds: Number of seeds.
        planted: Factor on b's hidden cost.
        within: How much a metric differs between two runs on the same detections though nothing changed, as a share.
    """
    found, hardness = [], rng.standard_normal(seeds)
    for quantity in compared_quantities():
        if quantity.key not in PRIMARY:
            continue
        a, b = (np.exp(0.15 * hardness + within / np.sqrt(2.0) * rng.standard_normal(seeds)) for _ in range(2))
        found.append(arms(quantity, a, b * (planted if quantity.key == "hidden.hidden_cost_m" else 1.0)))
    return found


@pytest.mark.parametrize("seeds", [3, 10])
def test_no_change_is_called_worse_in_at_most_five_percent_of_comparisons(seeds):
    rng = np.random.default_rng([7, seeds])
    worse = [any(verdict.regression for verdict in judged(*simulated(rng, seeds), rules=Rules())) for _ in range(400)]
    assert np.mean(worse) <= 0.05


@pytest.mark.parametrize("seeds", [3, 10])
def test_what_is_worse_by_the_tolerance_and_more_passes_as_no_worse_in_at_most_five_percent(seeds):
    rng = np.random.default_rng([8, seeds])
    passed = 0
    for _ in range(300):
        verdicts = judged(*simulated(rng, seeds, planted=1.021, within=0.01), rules=Rules())
        passed += all(verdict.verdict in (NO_WORSE, BETTER) for verdict in verdicts)
    assert passed / 300 <= 0.05
