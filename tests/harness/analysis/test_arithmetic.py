"""Numbers of comparisons held against scipy and plain sums, and verdicts exactly at their thresholds."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from harness.analysis.arms import Arms, Layout, lost_values, measure, pair
from harness.analysis.rules import STEP_TIME, Rules
from harness.analysis.verdicts import BETTER, NO_WORSE, UNDECIDED, UNTESTED, WORSE, MetricDifference, judge
from harness.common.effects import MOST_UNITS, Effect, neighbours_effect, paired_effect, unpaired_effect
from harness.scoring.metrics.quantity import Quantity

ERROR, SCORE = Quantity("error", "error, m"), Quantity("score", "score, %", higher_is_better=True)
RULES = Rules(primary=("error", "score"))
NAN = float("nan")


@pytest.mark.parametrize("units", [2.0, 3.0, 7.5])
def test_an_interval_and_a_p_value_are_students(units):
    effect = Effect(-1.5, 0.4, units)
    of = stats.t(units - 1.0)
    assert effect.ci95 == pytest.approx((-1.5 - of.ppf(0.975) * 0.4, -1.5 + of.ppf(0.975) * 0.4))
    assert effect.p == pytest.approx(2.0 * of.sf(1.5 / 0.4))


def test_of_a_unit_and_a_half_and_less_half_a_degree_of_freedom_is_left():
    half = stats.t(0.5).ppf(0.975)
    assert Effect(0.0, 1.0, 1.2).ci95[1] == Effect(0.0, 1.0, 1.5).ci95[1] == pytest.approx(half)
    assert Effect(0.0, 1.0, 1.6).ci95[1] == pytest.approx(stats.t(0.6).ppf(0.975))


def test_without_scatter_a_difference_is_certain_and_with_unknown_scatter_nothing_is():
    assert [Effect(difference, 0.0, 3.0).p for difference in (0.0, 0.1, -0.1)] == [1.0, 0.0, 0.0]
    assert Effect(2.0, 0.0, 3.0).ci95 == (2.0, 2.0)
    unknown = Effect(2.0, NAN, 3.0)
    assert np.isnan([unknown.p, *unknown.ci95]).all()
    assert unknown.units_to_decide(1.0, 1, 2.0) is None


@pytest.mark.parametrize(
    ("worsening", "margin", "tests", "away", "level"),
    [(3.0, 2.0, 3, 3.0, 0.05 / 3), (1.0, 2.0, 3, 1.0, 0.025), (-1.0, 0.5, 2, 1.5, 0.025), (0.3, 0.1, 1, 0.3, 0.05)],
)
def test_the_units_that_would_decide_are_the_first_whose_interval_and_power_reach_so_far(
    worsening, margin, tests, away, level
):
    effect = Effect(worsening, 0.8, 4.0)
    sd = 0.8 * 4.0**0.5
    tried = np.unique(np.geomspace(5.0, MOST_UNITS, 200).astype(int))
    needed = (stats.t.ppf(1 - level, tried - 1) + stats.norm.ppf(0.8)) * sd
    assert effect.units_to_decide(margin, tests, worsening) == tried[needed <= away * np.sqrt(tried)][0]


def test_no_number_of_units_decides_what_lies_at_the_margin():
    assert Effect(2.0, 0.5, 4.0).units_to_decide(2.0, 1, 2.0) is None
    assert Effect(1.999, 5.0, 4.0).units_to_decide(2.0, 1, 1.999) is None
    assert Effect(5.0, 0.001, 1.0).units_to_decide(1.0, 1, 5.0) == 3


def test_pairs_of_seeds_at_several_densities_have_the_scatter_of_their_seeds():
    a, shift = np.array([5.0, 6.0, 7.0, 9.0, 9.0, 9.0]), np.array([1.0, 2.0, 4.0, 3.0, 5.0, 4.0])
    density, seed = np.repeat([0, 1], 3), np.tile([7, 8, 9], 2)
    effect = paired_effect(a, a + shift, density, seed)
    centred = shift - np.array([7 / 3] * 3 + [4.0] * 3)
    by_seed = (centred[:3] + centred[3:]) / 6
    assert (effect.difference, effect.units) == (pytest.approx(shift.mean()), 3.0)
    assert effect.se == pytest.approx(np.sqrt(3 / 2 * (by_seed**2).sum()))
    nothing = paired_effect(*[np.zeros(0)] * 2, *[np.zeros(0, dtype=int)] * 2)
    assert np.isnan([nothing.difference, nothing.se]).all()
    assert nothing.units == 0.0


def test_where_a_density_has_a_single_run_all_are_held_against_their_common_mean():
    shift, density, seed = np.array([1.0, 2.0, 6.0]), np.array([0, 0, 1]), np.array([0, 1, 1])
    effect = paired_effect(np.zeros(3), shift, density, seed)
    # Without either seed the mean of 3 is that of the other's runs, 4 or 1.
    assert effect.se == pytest.approx(np.sqrt(1 / 2 * ((4 - 3) ** 2 + (1 - 3) ** 2)))


def test_unpaired_arms_have_the_difference_of_their_settings_means_and_welchs_freedom():
    a, of_a = np.array([1.0, 3.0, 10.0, 14.0, 99.0]), (np.array([0, 0, 1, 1, 5]), np.array([0, 1, 2, 3, 4]))
    b, of_b = np.array([2.0, 3.0, 7.0, 12.0]), (np.array([0, 0, 0, 1]), np.array([0, 1, 2, 3]))
    effect = unpaired_effect(a, b, (of_a[0], of_b[0]), (of_a[1], of_b[1]))
    assert effect.difference == pytest.approx((4.0 + 12.0) / 2 - (2.0 + 12.0) / 2)
    # Without a seed of a, the mean of 8 and 12, half of each, is that with the other's value at its setting.
    se_a = np.sqrt(3 / 4 * 2 * ((1 / 2) ** 2 + (2 / 2) ** 2))
    weights = np.array([1 / 6, 1 / 6, 1 / 6, 1 / 2])
    se_b = np.sqrt(3 / 4 * ((weights / (1 - weights) * (b - 8.0)) ** 2).sum())
    assert effect.se == pytest.approx(np.hypot(se_a, se_b))
    assert effect.units - 1.0 == pytest.approx((se_a**2 + se_b**2) ** 2 / (se_a**4 / 3 + se_b**4 / 3))
    alone = unpaired_effect(a, b, (of_a[0], of_b[0] + 20), (of_a[1], of_b[1]))
    assert np.isnan(alone.difference)


def test_one_run_of_an_arm_leaves_the_scatter_of_both_unknown():
    effect = unpaired_effect(
        np.ones(3), np.ones(1), (np.zeros(3, int), np.zeros(1, int)), (np.arange(3), np.zeros(1, int))
    )
    assert (effect.difference, np.isnan(effect.se)) == (0.0, True)


def test_neighbours_count_by_their_closeness():
    influence = np.array([0.5, -0.2, -0.3])
    near = np.array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.0], [0.0, 0.0, 1.0]])
    effect = neighbours_effect(2.0, influence, near)
    units = 9 / 4.0
    assert (effect.difference, effect.units) == (2.0, units)
    # Those of opposite sign may not take away from what each has by itself.
    assert effect.se == pytest.approx(np.sqrt(0.38) * units / (units - 1))
    alike = neighbours_effect(2.0, np.array([0.5, 0.4, -0.9]), near)
    assert alike.se == pytest.approx(np.sqrt(0.25 + 0.16 + 0.81 + 2 * 0.5 * 0.2) * units / (units - 1))
    two = neighbours_effect(2.0, np.array([0.5, -0.5]), np.eye(2))
    assert (two.units, np.isnan(two.se)) == (2.0, True)
    assert neighbours_effect(2.0, np.zeros(0), np.zeros((0, 0))).units == 0.0


def layout(n: int, m: int | None = None) -> Layout:
    sizes = (n, n if m is None else m)
    zeros, each = (tuple(made(size) for size in sizes) for made in (lambda k: np.zeros(k, dtype=np.int64), np.arange))
    return Layout(m is None, zeros, each)


def test_pairs_without_a_half_are_left_out_of_everything():
    a, b = np.array([1.0, NAN, 3.0, 5.0]), np.array([2.0, 2.0, np.inf, 8.0])
    told = measure(Arms("x", ERROR, a, b, layout(4)))
    assert (told.label, told.quantity, told.a, told.b, told.pairs, told.same) == ("x", ERROR, 3.0, 5.0, 2, False)
    assert (told.effect.difference, told.effect.units) == (2.0, 2.0)
    assert told.wanting == "b lacks 1 of the 3 values that a has"
    other = measure(Arms("x", ERROR, a, b[:3], layout(4, 3)))
    assert (other.a, other.b, other.pairs, other.same) == (3.0, 2.0, 2, False)
    assert other.effect.difference == -1.0
    equal = measure(Arms("x", ERROR, a, a, layout(4)))
    assert (equal.same, equal.pairs) == (True, 3)
    assert not measure(Arms("x", ERROR, a, a, layout(4, 4))).same
    nothing = measure(Arms("x", ERROR, a, np.full(4, NAN), layout(4)))
    assert (nothing.pairs, nothing.wanting, np.isnan(nothing.a)) == (0, "b has no value of it", True)


def test_compared_ratios_have_the_mean_of_sums_and_a_ratios_scatter_over_the_pairs_that_both_have():
    ratios, totals = np.array([0.5, 2.0, 1.0, 9.0]), np.array([8.0, 1.0, 3.0, 5.0])
    a, totals_a = np.array([1.5, 1.5, 1.5, NAN]), np.array([2.0, 1.0, 4.0, NAN])
    told = measure(Arms("x", ERROR, a, ratios, layout(4), (totals_a, totals)))
    assert (told.a, told.b, told.pairs) == (1.5, pytest.approx((4.0 + 2.0 + 3.0) / 12.0), 3)
    residuals = (ratios[:3] * totals[:3] - 0.75 * totals[:3]) / 12.0
    assert told.effect.se == pytest.approx(np.sqrt(3 / 2 * (residuals**2).sum()))
    older = measure(Arms("x", ERROR, ratios, ratios, layout(4), (totals, np.full(4, NAN))))
    assert older.a == older.b == pytest.approx(12.5 / 4)


def test_no_value_may_be_lost_unless_a_share_is_tolerated():
    there, few = np.ones(40, dtype=bool), np.arange(40) >= 2
    assert lost_values(there, few, True) == "b lacks 2 of the 40 values that a has"
    assert lost_values(there, few, True, 0.05) == lost_values(there, few, False, 0.05) == ""
    words = "b lacks 3 of the 40 values that a has"
    assert lost_values(there, np.arange(40) >= 3, True) == lost_values(there, np.arange(40) >= 3, False) == words
    assert lost_values(~few, few, True) == "b lacks 2 of the 2 values that a has"
    assert lost_values(few, there, False) == ""
    assert lost_values(np.arange(100) >= 9, np.arange(10) >= 9, False) == "b has 1 of 10 values, a 91 of 100"
    assert lost_values(np.ones(5, dtype=bool), np.arange(100) >= 5, False, 0.05) == ""
    assert lost_values(few, np.arange(60) >= 3, False, 0.05) == ""
    assert lost_values(~there, ~there, True) == ""


def measured(difference: float, se: float, units: float = 8.0, quantity: Quantity = ERROR, **other) -> MetricDifference:
    known = {"label": "x", "quantity": quantity, "a": 100.0, "b": 100.0 + difference, "pairs": 8, "same": False} | other
    return MetricDifference(effect=Effect(difference, se, units), **known)


def word(difference: float, se: float, **other) -> str:
    (verdict,) = judge([measured(difference, se, **other)], RULES)
    assert verdict.regression == (verdict.verdict == WORSE)
    return verdict.verdict


@pytest.mark.parametrize(
    ("difference", "found"), [(2.0, NO_WORSE), (2.0001, WORSE), (0.5, NO_WORSE), (0.0, NO_WORSE), (-0.0001, BETTER)]
)
def test_a_certain_difference_is_worse_only_beyond_the_tolerance(difference, found):
    assert word(difference, 0.0) == found
    assert word(-difference, 0.0, quantity=SCORE) == found


def test_an_interval_that_ends_beyond_the_tolerance_leaves_it_open():
    t = stats.t(7).ppf(0.975)
    assert word(0.0, 1.999 / t) == NO_WORSE
    assert word(0.0, 2.001 / t) == UNDECIDED
    assert word(1.0, 0.999 / t, quantity=SCORE) == BETTER
    assert word(-1.0, 0.999 / t, quantity=SCORE) == NO_WORSE
    assert word(-1.0, 1.001 / t, quantity=SCORE) == UNDECIDED


def test_worse_needs_both_a_small_one_sided_p_and_more_than_the_tolerance():
    t = stats.t(7).ppf(0.95)
    for quantity, sign in ((ERROR, 1.0), (SCORE, -1.0)):
        worse, better = (
            [word(sign * way * 3.0, 3.0 / t * factor, quantity=quantity) for factor in (0.999, 1.001)]
            for way in (1.0, -1.0)
        )
        assert (worse, better) == ([WORSE, UNDECIDED], [BETTER, NO_WORSE])


def test_the_level_is_shared_by_all_that_are_tested_and_by_nothing_else():
    t = stats.t(7).ppf(1 - 0.05 / 2)
    own, other = measured(3.0, 3.0 / t * 1.001), measured(0.0, 0.1)
    described = measured(9.0, 0.1, quantity=Quantity("else", "else"))
    first, last = judge([own, described], RULES)
    assert (first.verdict, last.verdict, last.ci95) == (WORSE, UNTESTED, described.effect.ci95)
    assert [each.verdict for each in judge([own, other], RULES)] == [UNDECIDED, NO_WORSE]
    known = measured(1.0, NAN, 1.0)
    assert [each.verdict for each in judge([own, known], RULES)] == [WORSE, UNDECIDED]


@pytest.mark.parametrize(
    ("difference", "units", "unknown"), [(0.0, 7.0, True), (0.0, 8.0, False), (-1.0, 2.0, True), (-1.0, 3.0, False)]
)
def test_equal_differences_tell_their_scatter_only_where_there_are_enough(difference, units, unknown):
    (verdict,) = judge([measured(difference, 0.0, units)], RULES)
    fewest = 8 if difference == 0.0 else 3
    told = f"all differences are equal, and fewer than {fewest} independent ones do not tell their scatter"
    assert verdict.wanting == (told if unknown else "")
    assert (verdict.verdict == UNDECIDED) == unknown
    assert np.isnan(verdict.ci95).all() == unknown
    assert verdict.more_units is None


def test_what_is_wanting_leaves_anything_undecided_but_what_is_worse_all_the_same():
    lost = {"wanting": "b lacks 3"}
    assert word(-9.0, 0.1, **lost) == word(0.0, 0.1, **lost) == UNDECIDED
    assert word(9.0, 0.1, **lost) == WORSE
    described = measured(9.0, 0.1, quantity=Quantity("else", "else"), **lost)
    assert [(each.verdict, each.wanting) for each in judge([described], Rules())] == [(UNDECIDED, "b lacks 3")]
    found = judge([described, measured(0.0, 0.1)], RULES)
    assert [each.verdict for each in found] == [UNTESTED, NO_WORSE], "of chosen metrics only they decide"
    nothing = {"pairs": 0, "a": NAN}
    assert word(NAN, NAN, **nothing) == UNTESTED
    assert word(NAN, NAN, **nothing, **lost) == UNDECIDED


def test_runs_of_which_every_value_is_the_same_are_no_worse_and_one_that_differs_ends_that():
    same = [measured(0.0, NAN, 1.0, same=True), measured(NAN, NAN, 0.0, pairs=0)]
    verdict, nothing = judge(same, RULES)
    assert (verdict.verdict, verdict.p, verdict.wanting, nothing.verdict) == (NO_WORSE, 1.0, "", UNTESTED)
    other = measured(1.0, 0.1, quantity=Quantity("else", "else"))
    assert judge([*same, other], RULES)[0].wanting == "too few to tell"


def test_the_time_of_a_step_differs_between_equal_runs_and_is_judged_alone():
    time = measured(50.0, 0.1, quantity=STEP_TIME)
    assert [each.verdict for each in judge([measured(0.0, NAN, 1.0, same=True), time], RULES)] == [NO_WORSE, WORSE]
    same = measured(0.0, NAN, 1.0, quantity=STEP_TIME, same=True)
    assert [each.verdict for each in judge([measured(9.0, 0.1), same], RULES)] == [WORSE, NO_WORSE]


def runs(*rows: tuple, columns=("density", "seed")) -> pd.DataFrame:
    return pd.DataFrame(rows, columns=list(columns))


def paired(a: pd.DataFrame, b: pd.DataFrame):
    found = pair(a, b, ["density"])
    sides = [values.tolist() for pair_ in (found.layout.strata, found.layout.units) for values in pair_]
    return found.of_a.tolist(), found.of_b.tolist(), found.layout.paired, sides, found.units, found.lacking


def test_runs_are_paired_by_setting_and_seed():
    a = runs((20.0, 1), (20.0, 2), (40.0, 1), (60.0, 1))
    b = runs((40.0, 1), (20.0, 2), (20.0, 3))
    both = [[0, 1], [0, 1]]
    assert paired(a, b) == ([1, 2], [1, 0], True, [*both, *both], "seeds", (
        "b lacks 2 of the 4 runs of a (density 20: seed 1; density 60: seed 1).",
        "a lacks 1 of the 3 runs of b (density 20: seed 3).",
    ))  # fmt: skip
    fewer = runs((20.0, 1), (20.0, 2), (20.0, 3), (20.0, 7), (40.0, 9))
    assert paired(fewer, runs((20.0, 3)))[5] == (
        "b lacks 4 of the 5 runs of a (density 20: seeds 1 to 2, 7; density 40: seed 9).",
    )
    assert paired(fewer, fewer)[5] == ()


def test_without_common_seeds_all_runs_of_common_settings_are_taken():
    a, b = runs((20.0, 1), (40.0, 1), (20.0, 2)), runs((60.0, 8), (20.0, 9), (20.0, 8))
    assert paired(a, b) == ([0, 2], [1, 2], False, [[0, 0], [0, 0], [0, 1], [2, 3]], "seeds", (
        "b lacks 1 of the 3 runs of a (density 40).", "a lacks 1 of the 3 runs of b (density 60).",
    ))  # fmt: skip
    assert paired(runs((20.0, 1)), runs((40.0, 1)))[:3] == ([], [], False)


def test_a_single_seed_at_several_densities_decides_nothing():
    a = runs((20.0, 1), (40.0, 1), (60.0, 1))
    effect = measure(Arms("x", ERROR, np.zeros(3), np.array([5.0, 5.1, 5.2]), pair(a, a, ["density"]).layout)).effect
    assert (effect.units, np.isnan(effect.se)) == (1.0, True)


def test_recordings_are_the_units_where_both_have_them_and_settings_without_a_value_are_one():
    columns = ("density", "seed", "replay")
    a, b = (runs((None, 0, "x"), (None, 0, other), columns=columns) for other in ("y", "z"))
    found = paired(a, a)
    assert (found[0], found[3], found[4]) == ([0, 1], [[0, 0], [0, 0], [0, 1], [0, 1]], "recordings")
    assert paired(a, b)[:2] == ([0], [0])
    assert paired(a, b.drop(columns="replay"))[4] == "seeds"
