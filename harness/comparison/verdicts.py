"""From two arms' values to a verdict on each metric, at most 5 % false alarms over all of them together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.scoring.metrics import quantities
from harness.scoring.quantity import Quantity
from harness.scoring.statistics import Interval, PairedDifference, paired_difference, resampled_means
from mmpf.compute.arrays import FloatArray, IntArray

LEVEL = 0.05
DRAWS = 10_000
BETTER, WORSE, SAME, UNTESTED, UNDECIDED = "better", "worse", "no difference", "not tested", "undecided"
# So large a share of the first arm's values may be without one in the second before nothing is concluded from the rest.
TOLERATED_LOSS = 0.05


def compared_quantities() -> list[Quantity]:
    """Return what verdicts are given on: hidden vehicles first, then errors, then what becomes of tracks, the rest."""
    return [quantity for quantity in quantities("hidden", "mae", "hidden_outcomes", "occlusion") if quantity.compared]


@dataclass(frozen=True)
class Arms:
    """The values of one metric in both arms.

    Attributes:
        label: What is compared: tracker and model.
        quantity: What the values are of.
        a: Values of the first arm, shape (n,).
        b: Values of the second, shape (n,) in the same order where paired, otherwise of any length.
        strata: Setting of each value of a and of b, each of shape (n,): densities and the like are kept apart; None
            where a and b are paired, that is were made on the same traffic and detections.
        testable: Whether a test makes sense; a single value of each arm can't be tested.
    """

    label: str
    quantity: Quantity
    a: FloatArray
    b: FloatArray
    strata: tuple[IntArray, IntArray] | None = None
    testable: bool = True


@dataclass(frozen=True)
class Verdict:
    """The verdict on one metric.

    Attributes:
        label: What is compared: tracker and model.
        metric: Key of the metric.
        a: Mean of the first arm.
        b: Mean of the second.
        difference: b minus a.
        ci95: Bootstrap interval of the difference.
        p: p value of no difference, corrected for the number of metrics and trackers by Holm's method.
        pairs: Number of pairs, or of values of the smaller arm where not paired.
        verdict: ``better``, ``worse``, ``no difference``, ``not tested`` or ``undecided``, of b.
        regression: Whether b is worse by more than the tolerance.
        wanting: What is missing for a verdict, in words; empty where nothing is.
    """

    label: str
    metric: str
    a: float
    b: float
    difference: float
    ci95: tuple[float, float]
    p: float
    pairs: int
    verdict: str
    regression: bool
    wanting: str = ""


def judge(arms: Sequence[Arms], tolerance: float = 0.0, draws: int = DRAWS) -> list[Verdict]:
    """Give a verdict on every metric.

    Paired arms are tested by flipping the signs of the differences, others by exchanging values between the arms within
    each setting; both are exact, so that with Holm's correction the probability of any false verdict is at most 5 %.

    Args:
        arms: The values.
        tolerance: A worse value is a regression if the difference exceeds this share of a.
        draws: Number of resamples, and of permutations where they are too many to try all.
    """
    compared = [_cleaned(arm) for arm in arms]
    differences = [_difference(arm, draws) for arm in compared]
    corrected = holm(np.array([difference.p for difference in differences]))
    verdicts = [
        _verdict(arm, difference, p, tolerance)
        for arm, difference, p in zip(compared, differences, corrected.tolist(), strict=True)
    ]
    tests = int(np.isfinite(corrected).sum())
    return [
        _undecided(verdict, _wanting(arm, left, verdict, tests, tolerance))
        for verdict, arm, left in zip(verdicts, arms, compared, strict=True)
    ]


def holm(p: FloatArray) -> FloatArray:
    """Correct p values for their number (Holm 1979); nan is no test and counts for nothing.

    Args:
        p: p values, shape (n,).
    """
    tested = np.flatnonzero(np.isfinite(p))
    order = tested[np.argsort(p[tested], kind="stable")]
    steps = p[order] * (len(order) - np.arange(len(order)))
    corrected = np.full(len(p), np.nan)
    corrected[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return corrected


def fewest_pairs(tests: int) -> int:
    """Return how many pairs the sign-flip test needs before any verdict can fall, given the number of tests."""
    return int(np.ceil(1.0 + np.log2(tests / LEVEL)))


def _undecided(verdict: Verdict, wanting: str) -> Verdict:
    """Return the verdict with what is missing for it; a regression that shows all the same stays one."""
    if not wanting:
        return verdict
    single = verdict.verdict == UNTESTED and np.isfinite(verdict.difference)
    return replace(verdict, verdict=verdict.verdict if verdict.regression or single else UNDECIDED, wanting=wanting)


def _wanting(given: Arms, left: Arms, verdict: Verdict, tests: int, tolerance: float) -> str:
    """Return why the values allow no verdict; empty where they do, or where the first arm has none either."""
    a, b = np.isfinite(given.a), np.isfinite(given.b)
    if not a.any():
        return ""
    if not b.any():
        return "b has no value of it"
    lost = int((a & ~b).sum()) if given.strata is None else max(0, int((~b).sum()) - int((~a).sum()))
    if lost > TOLERATED_LOSS * a.sum():
        return f"b lacks {lost} of the {int(a.sum())} values that a has"
    if not given.testable:
        # One value a side can't be tested, but may not pass where it looks worse either.
        worsening = verdict.difference if not given.quantity.higher_is_better else -verdict.difference
        return "b is worse in a single run, which can't be tested" if worsening > tolerance * abs(verdict.a) else ""
    if _smallest_p(left) * max(tests, 1) > LEVEL:
        return f"{verdict.pairs} {'pairs are' if given.strata is None else 'runs of an arm are'} too few"
    return ""


def _smallest_p(arms: Arms) -> float:
    """Return the smallest p value that the test of so many values can give."""
    if arms.strata is None:
        return 2.0 ** (1 - len(arms.a)) if len(arms.a) else 1.0
    ways = 1.0
    for stratum in np.intersect1d(*arms.strata):
        of_a, of_b = (int((strata == stratum).sum()) for strata in arms.strata)
        ways *= math.comb(of_a + of_b, of_a)
    return min(1.0, 2.0 / ways)


def unpaired_difference(
    a: FloatArray, b: FloatArray, stratum_a: IntArray, stratum_b: IntArray, rng: np.random.Generator, draws: int = DRAWS
) -> PairedDifference:
    """Compare two arms that ran on different seeds, by exchanging values between them within each setting.

    The statistic is the mean over settings of the difference of the arms' means.

    Args:
        a: Values of the first arm, shape (n,).
        b: Values of the second, shape (m,).
        stratum_a: Setting of each value of a, shape (n,).
        stratum_b: Setting of each value of b, shape (m,).
        rng: Source of the permutations and resamples.
        draws: Number of each.

    Returns:
        The difference; nan where no setting is in both arms.
    """
    permuted, resampled, observed = np.zeros(draws), np.zeros(draws), 0.0
    common = np.intersect1d(stratum_a, stratum_b)
    for stratum in common:
        left, right = a[stratum_a == stratum], b[stratum_b == stratum]
        observed += float(right.mean() - left.mean())
        pool = np.tile(np.concatenate([left, right]), (draws, 1))
        mixed = rng.permuted(pool, axis=1)
        permuted += mixed[:, len(left) :].mean(axis=1) - mixed[:, : len(left)].mean(axis=1)
        resampled += resampled_means(right, rng, draws) - resampled_means(left, rng, draws)
    if not len(common):
        return PairedDifference(np.nan, Interval(np.nan, np.nan), np.nan)
    low, high = np.quantile(resampled, (0.025, 0.975)) / len(common)
    extreme = np.count_nonzero(np.abs(permuted) >= abs(observed) * (1.0 - 1e-12))
    return PairedDifference(observed / len(common), Interval(float(low), float(high)), (extreme + 1) / (draws + 1))


def _cleaned(arms: Arms) -> Arms:
    """Leave out values that are nan, with their partners where paired."""
    a, b = np.isfinite(arms.a), np.isfinite(arms.b)
    if arms.strata is None:
        return replace(arms, a=arms.a[a & b], b=arms.b[a & b])
    return replace(arms, a=arms.a[a], b=arms.b[b], strata=(arms.strata[0][a], arms.strata[1][b]))


def _difference(arms: Arms, draws: int) -> PairedDifference:
    rng = np.random.default_rng(0)
    if not arms.testable:
        mean = float(arms.b.mean() - arms.a.mean()) if len(arms.a) and len(arms.b) else np.nan
        return PairedDifference(mean, Interval(np.nan, np.nan), np.nan)
    if arms.strata is None:
        return paired_difference(arms.a, arms.b, rng, draws=draws)
    return unpaired_difference(arms.a, arms.b, *arms.strata, rng, draws)


def _verdict(arms: Arms, difference: PairedDifference, p: float, tolerance: float) -> Verdict:
    a, b = (float(values.mean()) if len(values) else np.nan for values in (arms.a, arms.b))
    word = UNTESTED
    if np.isfinite(p):
        improved = (difference.difference > 0.0) == arms.quantity.higher_is_better
        word = SAME if p > LEVEL else BETTER if improved else WORSE
    return Verdict(
        label=arms.label,
        metric=arms.quantity.key,
        a=a,
        b=b,
        difference=difference.difference,
        ci95=(difference.interval.low, difference.interval.high),
        p=p,
        pairs=min(len(arms.a), len(arms.b)),
        verdict=word,
        regression=word == WORSE and abs(difference.difference) > tolerance * abs(a),
    )
