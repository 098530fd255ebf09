"""Turns a difference and its uncertainty into a verdict on each metric that is judged.

A verdict is one of three: worse; no worse than the tolerance, shown by an interval that lies within it; undecided. The
tests of worse and better share one level of 5 % by Holm's method; that of no worse needs no such correction, since all
metrics have to pass it.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from harness.analysis.rules import STEP_TIME, Rules
from harness.common.effects import LEVEL, Effect
from harness.scoring.metrics.quantity import Quantity
from mmpf.numerics.arrays import FloatArray

BETTER, WORSE, NO_WORSE, UNTESTED, UNDECIDED = "better", "worse", "no worse", "not tested", "undecided"
TOO_FEW = "too few to tell"
FEWEST_EQUAL, FEWEST_SHIFTED = 8, 3
"""Units that may all show no difference, or one and the same other, before that is taken for certain."""
FEWEST_TOLD = 5.0
"""With fewer units an interval that reaches beyond what the metric can be says nothing, and is not told."""


@dataclass(frozen=True)
class MetricDifference:
    """The difference of one metric of a tracker and model.

    Attributes:
        pairs: Number of pairs, or of values of the smaller arm where not paired.
        same: Whether every value of b is that of a.
        wanting: What is missing for a verdict, in words; empty where nothing is.
    """

    label: str
    quantity: Quantity
    a: float
    b: float
    effect: Effect
    pairs: int
    same: bool
    wanting: str = ""


@dataclass(frozen=True)
class Verdict:
    """The verdict on one metric, which is primary, or described alone, of a tracker and model.

    Attributes:
        difference: b minus a.
        ci95: Its 95 % interval; nan where nothing is known of its scatter.
        p: One-sided p value of being worse, or of being better where the difference is, corrected for the number of
            verdicts by Holm's method; nan without a test.
        pairs: Number of pairs, or of values of the smaller arm where not paired.
        units: Number of independent units: seeds, or the vehicles' effective number.
        margin: By how much b may be worse.
        verdict: Of b: ``worse``, ``no worse``, ``better`` (which is no worse too), ``undecided``; ``not tested`` where
            it is only described.
        more_units: How many more units would decide what is undecided, if all else stays; None where unknown.
        wanting: What is missing for a verdict, in words; empty where nothing is.
        breach: How b's value breaks its floor or ceiling, in words; empty where it does not.
    """

    label: str
    metric: str
    primary: bool
    a: float
    b: float
    difference: float
    ci95: tuple[float, float]
    p: float
    pairs: int
    units: float
    margin: float
    verdict: str
    regression: bool
    more_units: int | None = None
    wanting: str = ""
    breach: str = ""


def judge(measured: Sequence[MetricDifference], rules: Rules | None = None) -> list[Verdict]:
    """Give a verdict on every metric that is judged, and describe the others.

    Args:
        rules: What is judged, and how much worse is put up with; None for the usual.

    Returns:
        A verdict each, in their order. The probability that any of them is worse though nothing differs is at most
        5 %, and so is that of better.
    """
    rules = rules or Rules()
    # Equal bytes are no sample: nothing has changed, however few runs there are.
    changed = {_part(each) for each in measured if each.pairs and not each.same}
    tested = [each if rules.judges(each.quantity) and not _unknown(each, changed) else None for each in measured]
    still = np.array([each is not None and _part(each) not in changed for each in tested], dtype=bool)
    worse = np.array([np.nan if each is None else _p_of_worse(each) for each in tested])
    worse[still] = 1.0
    better = np.where(still, 1.0, 1.0 - worse)
    corrected = np.where(worse <= better, holm(worse), holm(np.where(np.isnan(worse), np.nan, better)))
    tests = max(1, int(np.isfinite(corrected).sum()))
    return [
        _verdict(each, rules, p, tests, _unknown(each, changed))
        for each, p in zip(measured, corrected.tolist(), strict=True)
    ]


def _part(measured: MetricDifference) -> tuple[str, bool]:
    """Return whose metric it is, and whether it is a time, which differs between equal runs too."""
    return measured.label, measured.quantity.key == STEP_TIME.key


def _p_of_worse(measured: MetricDifference) -> float:
    """Return the one-sided p value of b being no worse."""
    half = 0.5 * measured.effect.p
    return half if _worsening(measured) > 0.0 else 1.0 - half


def _worsening(measured: MetricDifference) -> float:
    return -measured.effect.difference if measured.quantity.higher_is_better else measured.effect.difference


def _possible(measured: MetricDifference) -> tuple[float, float]:
    """Return the least and the largest difference that there can be from a's value."""
    quantity = measured.quantity
    return quantity.least - measured.a, quantity.most - measured.a


def _unknown(measured: MetricDifference, changed: Collection[tuple[str, bool]]) -> str:
    """Return why a difference's scatter is not known; empty where it is."""
    if _part(measured) not in changed or not measured.pairs:
        return ""
    if not np.isfinite(measured.effect.se):
        return TOO_FEW
    (low, high), (least, most) = measured.effect.ci95, _possible(measured)
    if measured.effect.units < FEWEST_TOLD and (low < least or high > most):
        return TOO_FEW
    fewest = FEWEST_EQUAL if measured.effect.difference == 0.0 else FEWEST_SHIFTED
    if measured.effect.se == 0.0 and measured.effect.units < fewest:
        return f"all differences are equal, and fewer than {fewest} independent ones do not tell their scatter"
    return ""


def _verdict(measured: MetricDifference, rules: Rules, p: float, tests: int, unknown: str) -> Verdict:
    effect, primary = measured.effect, rules.judges(measured.quantity)
    margin = rules.margin(measured.quantity, measured.a)
    sign = -1.0 if measured.quantity.higher_is_better else 1.0
    worsening = _worsening(measured)
    worst = max(sign * end for end in effect.ci95) if measured.effect.se > 0.0 else worsening
    word, wanting = UNTESTED, measured.wanting
    limit = rules.limit(measured.quantity)
    breach = limit.breach(measured.b, measured.quantity) if primary else ""
    if primary and (measured.pairs or wanting):
        word, wanting = UNDECIDED, wanting or unknown
        if breach or (p <= LEVEL and worsening > margin):
            word = WORSE
        elif not wanting and p <= LEVEL and worsening < 0.0:
            word = BETTER
        elif not wanting and worst <= margin:
            word = NO_WORSE
    elif wanting and not rules.are_chosen:
        word = UNDECIDED
    more = effect.units_to_decide(margin, tests, worsening) if word == UNDECIDED and wanting in ("", TOO_FEW) else None
    low, high = np.clip(effect.ci95, *_possible(measured)) if np.isfinite(measured.a) else effect.ci95
    return Verdict(
        label=measured.label,
        metric=measured.quantity.key,
        primary=primary,
        a=measured.a,
        b=measured.b,
        difference=effect.difference,
        ci95=(np.nan, np.nan) if unknown else (float(low), float(high)),
        p=p,
        pairs=measured.pairs,
        units=effect.units,
        margin=margin,
        verdict=word,
        regression=word == WORSE,
        more_units=None if more is None else max(1, int(np.ceil(more - effect.units))),
        wanting=wanting,
        breach=breach,
    )


def holm(p: FloatArray) -> FloatArray:
    """Correct p values, shape (n,), for their number (Holm 1979); nan is no test and counts for nothing."""
    tested = np.flatnonzero(np.isfinite(p))
    order = tested[np.argsort(p[tested], kind="stable")]
    steps = p[order] * (len(order) - np.arange(len(order)))
    corrected = np.full(len(p), np.nan)
    corrected[order] = np.minimum(np.maximum.accumulate(steps), 1.0)
    return corrected
