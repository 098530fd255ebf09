"""Pairs the runs of two grids; the values of a metric in both arms of a comparison, and their difference."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from harness.analysis.verdicts import MetricDifference
from harness.common.effects import in_proportion, paired_effect, unpaired_effect
from harness.scoring.metrics.quantity import Quantity
from harness.storage.schema import RECORDING
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

TOLERATED_LOSS = 0.05
"""Share of the first arm's values that may be without one in the second, of metrics that are only described."""


@dataclass(frozen=True)
class Layout:
    """What the values of both arms belong to.

    Attributes:
        paired: Whether the arms were made on the same traffic and detections, value by value.
        strata: Setting of each value of a and of b: densities and the like are kept apart.
        units: Independent unit of each value of a and of b, such as its seed.
    """

    paired: bool
    strata: tuple[IntArray, IntArray]
    units: tuple[IntArray, IntArray]


@dataclass(frozen=True)
class Arms:
    """The values of one metric in both arms.

    Attributes:
        label: What is compared: tracker and model.
        a: Values of the first arm, shape (n,).
        b: Values of the second, shape (n,) in the same order where paired, otherwise of any length.
        totals: Of ratios, what each is a ratio to, shapes (n,); None where all values count the same.
    """

    label: str
    quantity: Quantity
    a: FloatArray
    b: FloatArray
    layout: Layout
    totals: tuple[FloatArray, FloatArray] | None = None


def measure(arms: Arms, tolerated_loss: float = 0.0) -> MetricDifference:
    """Return the difference of both arms; values that are nan are left out, with their partners where paired.

    Nothing is concluded where b lacks more than a tolerated share of a's values.
    """
    there, layout = (np.isfinite(arms.a), np.isfinite(arms.b)), arms.layout
    known_a, known_b = (there[0] & there[1],) * 2 if layout.paired else there
    a, b = arms.a[known_a], arms.b[known_b]
    totals = () if arms.totals is None else (arms.totals[0][known_a], arms.totals[1][known_b])
    if totals and all(total.sum() > 0.0 for total in totals):  # older rows lack the totals
        a, b = in_proportion(a, totals[0]), in_proportion(b, totals[1])
    strata, units = ((pair[0][known_a], pair[1][known_b]) for pair in (layout.strata, layout.units))
    effect = paired_effect(a, b, strata[0], units[0]) if layout.paired else unpaired_effect(a, b, strata, units)
    return MetricDifference(
        label=arms.label,
        quantity=arms.quantity,
        a=_mean(a),
        b=_mean(b if len(b) else arms.b[there[1]]),
        effect=effect,
        pairs=min(len(a), len(b)),
        same=layout.paired and bool((a == b).all()),
        wanting=lost_values(*there, layout.paired, tolerated_loss),
    )


def lost_values(a: BoolArray, b: BoolArray, paired: bool, tolerated: float = 0.0) -> str:
    """Return a sentence on the values that one arm has and the other lacks; empty where few are missing.

    Args:
        a: Which values of the first arm are there, shape (n,).
        b: Likewise of the second, shape (n,) where paired, else of any length.
        paired: Whether they belong together one by one.
        tolerated: Share of a's values that b may lack. If it is 0, a may lack none of b's either.
    """
    if a.any() != b.any():
        lacking = "b" if a.any() else "a"
        return "" if tolerated and lacking == "a" else f"{lacking} has no value of it"
    # Of arms of different sizes shares are compared: what b would have if it lacked as few as a.
    whole = int(a.sum()) if paired else int(len(b) * float(a.mean()) + 1e-9 if len(a) else 0)
    lost = int((a & ~b).sum()) if paired else max(0, whole - int(b.sum()))
    if lost > tolerated * whole and whole != a.sum():
        return f"b has {int(b.sum())} of {len(b)} values, a {int(a.sum())} of {len(a)}"
    if lost > tolerated * whole:
        return f"b lacks {lost} of the {whole} values that a has"
    more = int((b & ~a).sum()) if paired and not tolerated else 0
    return f"a lacks {more} of the {int(b.sum())} values that b has" if more else ""


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if len(values) else np.nan


MOST_LISTED = 4
"""Settings with missing runs that are listed."""


@dataclass(frozen=True)
class Pairing:
    """Which rows of two tables of runs are compared.

    Attributes:
        of_a: Rows of the first, shape (n,).
        of_b: Rows of the second, in the same order where paired, shape (m,).
        units: What the independent units are, in the plural.
        lacking: What each side lacks of the other's runs, a sentence each.
    """

    of_a: IntArray
    of_b: IntArray
    layout: Layout
    units: str
    lacking: tuple[str, ...]


def pair(a: pd.DataFrame, b: pd.DataFrame, settings: list[str]) -> Pairing:
    """Pair runs of one tracker by setting and seed; without common ones, take all runs of common settings.

    Independent are recordings, else seeds, of which a single one decides nothing, even at several densities.
    """
    recorded = [RECORDING] if RECORDING in a and RECORDING in b else []
    world_a, world_b = _numbered(a, b, [*settings, *recorded])
    keys_a = {key: place for place, key in enumerate(zip(world_a.tolist(), a["seed"], strict=True))}
    keys_b = {key: place for place, key in enumerate(zip(world_b.tolist(), b["seed"], strict=True))}
    common = [key for key in keys_a if key in keys_b]
    if common:
        of_a, of_b = (np.array([keys[key] for key in common], dtype=np.int64) for keys in (keys_a, keys_b))
    else:
        of_a, of_b = (np.flatnonzero(np.isin(*pair)) for pair in ((world_a, world_b), (world_b, world_a)))
    first, second = a.iloc[of_a], b.iloc[of_b]
    units = _numbered(first, second, recorded or ["seed"])
    strata = _numbered(first, second, settings)
    sides = (("b", "a", a, of_a), ("a", "b", b, of_b))
    lacking = (_lacking(*side, [*settings, *recorded], bool(common)) for side in sides)
    layout, in_words = Layout(bool(common), strata, units), "recordings" if recorded else "seeds"
    return Pairing(of_a, of_b, layout, in_words, tuple(filter(None, lacking)))


def _lacking(side: str, other: str, runs: pd.DataFrame, shared: IntArray, settings: list[str], paired: bool) -> str:
    """Return which of the other side's runs a side lacks, by setting; empty where none."""
    lost = runs.iloc[np.setdiff1d(np.arange(len(runs)), shared)]
    told = []
    for _, rows in lost.groupby(settings, dropna=False, sort=False):
        values = rows[settings].iloc[0].dropna().items()
        where = ", ".join(f"{key} {value:g}" if isinstance(value, float) else str(value) for key, value in values)
        told.append(f"{where}: {_spans(rows['seed'].tolist())}" if paired else where)
    more = f"; and {len(told) - MOST_LISTED} more settings" if len(told) > MOST_LISTED else ""
    listed = f"{'; '.join(told[:MOST_LISTED])}{more}"
    return f"{side} lacks {len(lost)} of the {len(runs)} runs of {other} ({listed})." if told else ""


def _spans(seeds: list[int]) -> str:
    """Return seeds as text, with consecutive ones as first to last."""
    ordered = np.sort(seeds)
    spans = np.split(ordered, np.flatnonzero(np.diff(ordered) != 1) + 1)
    words = ", ".join(f"{span[0]} to {span[-1]}" if len(span) > 1 else str(span[0]) for span in spans)
    return f"seed{'s' if len(seeds) > 1 else ''} {words}"


def _numbered(a: pd.DataFrame, b: pd.DataFrame, columns: list[str]) -> tuple[IntArray, IntArray]:
    """Number the distinct rows of some columns of two tables, shapes (rows of a,) and (rows of b,)."""
    both = pd.concat([a[columns], b[columns]], ignore_index=True).astype(object)
    if not len(both):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    number = both.where(both.notna(), "").apply(tuple, axis=1).factorize()[0].astype(np.int64)
    return number[: len(a)], number[len(a) :]
