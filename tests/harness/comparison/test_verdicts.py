"""Verdicts: their arithmetic, their false alarms and their power."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.comparison.verdicts import (
    BETTER,
    SAME,
    UNDECIDED,
    UNTESTED,
    WORSE,
    Arms,
    compared_quantities,
    fewest_pairs,
    holm,
    judge,
    unpaired_difference,
)
from harness.scoring.quantity import Quantity

COMPARED = compared_quantities()
ERROR, SCORE = Quantity("error", "error, m"), Quantity("score", "score, %", higher_is_better=True)


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


def test_the_direction_of_a_metric_decides_between_better_and_worse():
    lower, higher = np.arange(10.0) + 1.0, np.arange(10.0) + 2.0
    for metric, word in ((ERROR, WORSE), (SCORE, BETTER)):
        (verdict,) = judge([Arms("x", metric, lower, higher)])
        assert (verdict.verdict, verdict.difference, verdict.a, verdict.b) == (word, 1.0, 5.5, 6.5)


def test_only_a_worse_value_beyond_the_tolerance_is_a_regression():
    a, b = np.full(10, 100.0), np.full(10, 103.0)
    assert judge([Arms("x", ERROR, a, b)], tolerance=0.02)[0].regression
    assert not judge([Arms("x", ERROR, a, b)], tolerance=0.05)[0].regression
    assert not judge([Arms("x", ERROR, b, a)], tolerance=0.02)[0].regression
    assert judge([Arms("x", ERROR, a, b)], tolerance=0.05)[0].verdict == WORSE


def test_equal_arms_show_no_difference():
    values = np.arange(10.0)
    (verdict,) = judge([Arms("x", ERROR, values, values)])
    assert (verdict.verdict, verdict.p, verdict.difference) == (SAME, 1.0, 0.0)


def test_a_single_value_is_not_tested():
    (verdict,) = judge([Arms("x", ERROR, np.array([1.0]), np.array([2.0]), testable=False)])
    assert (verdict.verdict, verdict.regression, verdict.difference) == (UNTESTED, False, 1.0)


def test_pairs_with_a_missing_half_are_left_out():
    a, b = np.array([1.0, np.nan, 3.0]), np.array([2.0, 5.0, np.nan])
    (verdict,) = judge([Arms("x", ERROR, a, b)])
    assert (verdict.pairs, verdict.difference) == (1, 1.0)


@pytest.mark.parametrize("tests", [1, 11, 44])
def test_the_fewest_pairs_are_just_enough_for_a_verdict(tests):
    for pairs, word in ((fewest_pairs(tests), WORSE), (fewest_pairs(tests) - 1, UNDECIDED)):
        noise = 0.01 * np.arange(pairs)
        arms = [Arms("x", ERROR, noise, 5.0 + 2.0 * noise)]
        arms += [Arms("x", ERROR, np.arange(4.0), np.arange(4.0)) for _ in range(tests - 1)]
        assert judge(arms)[0].verdict == word


def test_without_pairs_each_setting_is_compared_with_itself():
    # The arms differ by 1 at either density; comparing across densities would say -39.
    density = np.repeat([0, 1], 6)
    a, b = np.where(density == 0, 10.0, 90.0), np.where(density == 0, 11.0, 91.0)
    found = unpaired_difference(a, b[4:], density, density[4:], np.random.default_rng(0), 2000)
    assert found.difference == pytest.approx(1.0)
    assert found.p < 0.01


@dataclass(frozen=True)
class Noise:
    """How much the metrics of runs scatter, as shares of their means.

    Attributes:
        between_seeds: Between seeds: the traffic differs.
        within_pair: Between two runs on the same detections: the tracker's random numbers differ.
    """

    between_seeds: float
    within_pair: float


# Measured over seeds 100 to 109 at 45 vehicles per km and lane, 15 s, mmpf with cvm and 200 or 201 particles.
MEASURED = dict(
    zip(
        (quantity.key for quantity in COMPARED),
        (
            Noise(0.214, 0.071), Noise(1.047, 0.687), Noise(0.051, 0.038), Noise(0.069, 0.041), Noise(0.159, 0.055),
            Noise(0.320, 0.154), Noise(0.203, 0.089), Noise(0.161, 0.079), Noise(0.244, 0.273), Noise(0.013, 0.009),
            Noise(0.015, 0.012), Noise(0.044, 0.015),
        ),
        strict=True,
    )
)  # fmt: skip


def simulated(
    rng: np.random.Generator, seeds: int, planted: dict[str, float], paired: bool, scatter: float = 1.0
) -> list[Arms]:
    """Draw both arms of all metrics; seeds move all metrics together, as dense or jammed traffic does."""
    arms = []
    hardness = rng.standard_normal((2, seeds))
    if paired:
        hardness[1] = hardness[0]
    for quantity in COMPARED:
        noise = MEASURED[quantity.key]
        own = rng.standard_normal((2, seeds)) * scatter * noise.within_pair / np.sqrt(2.0)
        a, b = np.exp(noise.between_seeds * hardness + own)
        b *= planted.get(quantity.key, 1.0)
        one = np.zeros(seeds, dtype=np.int64)
        arms.append(Arms("x", quantity, a, b, None if paired else (one, one)))
    return arms


@pytest.mark.slow
@pytest.mark.parametrize(
    ("paired", "seeds", "comparisons", "draws"),
    # Ten pairs are tested exactly, whatever the number of draws; the others' p values need draws to be small enough.
    [(True, 10, 4000, 20), (True, 20, 1500, 500), (False, 10, 1500, 500), (False, 20, 1500, 500)],
    ids=["10 pairs", "20 pairs", "10 seeds of each, none in common", "20 seeds of each, none in common"],
)
def test_identical_settings_raise_a_false_alarm_in_at_most_five_percent_of_comparisons(
    paired, seeds, comparisons, draws
):
    rng = np.random.default_rng([7, seeds])
    alarms = sum(
        any(verdict.verdict != SAME for verdict in judge(simulated(rng, seeds, {}, paired), draws=draws))
        for _ in range(comparisons)
    )
    assert alarms / comparisons <= 0.05


@pytest.mark.slow
def test_a_ten_percent_worse_tracker_is_found_at_ten_seeds_nine_times_in_ten():
    planted = {quantity.key: worse_by_ten_percent(quantity) for quantity in COMPARED}
    assert power(planted, any_metric=True) >= 0.9


@pytest.mark.slow
@pytest.mark.parametrize(
    "quantity",
    [quantity for quantity in COMPARED if MEASURED[quantity.key].within_pair <= 0.05],
    ids=lambda quantity: quantity.key,
)
def test_a_metric_that_scatters_by_up_to_five_percent_alone_shows_ten_percent_at_ten_seeds(quantity):
    assert power({quantity.key: worse_by_ten_percent(quantity)}) >= 0.9


@pytest.mark.slow
def test_the_hidden_error_alone_shows_ten_percent_in_a_whole_grid_of_ten_seeds():
    # Seven densities, and 60 s in place of the 15 s that the scatter was measured over: half of it by the square root.
    assert power({"mae.hidden.lon_m": 1.1}, seeds=70, scatter=0.5) >= 0.9


def worse_by_ten_percent(quantity: Quantity) -> float:
    return 0.9 if quantity.higher_is_better else 1.1


def power(planted: dict[str, float], any_metric=False, seeds=10, scatter=1.0, comparisons=200) -> float:
    """Return how often the planted regressions are called one."""
    rng, found = np.random.default_rng(11), 0
    for _ in range(comparisons):
        verdicts = judge(simulated(rng, seeds, planted, True, scatter), tolerance=0.02, draws=500)
        called = [verdict.regression for verdict in verdicts if verdict.metric in planted]
        found += any(called) if any_metric else all(called)
    return found / comparisons
