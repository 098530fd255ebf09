"""The values of a metric in both arms of a comparison, and their difference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.analysis.verdicts import MetricDifference
from harness.common.effects import paired_effect, unpaired_effect
from harness.scoring.metrics.quantity import Quantity
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
        quantity: What the values are of.
        a: Values of the first arm, shape (n,).
        b: Values of the second, shape (n,) in the same order where paired, otherwise of any length.
        layout: What they belong to.
    """

    label: str
    quantity: Quantity
    a: FloatArray
    b: FloatArray
    layout: Layout


def measure(arms: Arms, tolerated_loss: float = 0.0) -> MetricDifference:
    """Return the difference of both arms; values that are nan are left out, with their partners where paired.

    Nothing is concluded where b lacks more than a tolerated share of a's values.
    """
    known_a, known_b = np.isfinite(arms.a), np.isfinite(arms.b)
    layout = arms.layout
    if layout.paired:
        known_a = known_b = known_a & known_b
    a, b = arms.a[known_a], arms.b[known_b]
    strata, units = ((pair[0][known_a], pair[1][known_b]) for pair in (layout.strata, layout.units))
    effect = paired_effect(a, b, strata[0], units[0]) if layout.paired else unpaired_effect(a, b, strata, units)
    return MetricDifference(
        label=arms.label,
        quantity=arms.quantity,
        a=_mean(a),
        b=_mean(b),
        effect=effect,
        pairs=min(len(a), len(b)),
        same=layout.paired and bool((a == b).all()),
        wanting=lost_values(np.isfinite(arms.a), np.isfinite(arms.b), layout.paired, tolerated_loss),
    )


def lost_values(a: BoolArray, b: BoolArray, paired: bool, tolerated: float = 0.0) -> str:
    """Return a sentence on the values that a has and b lacks; empty where few are missing or a has none.

    Args:
        a: Which values of the first arm are there, shape (n,).
        b: Likewise of the second, shape (n,) where paired, else of any length.
        paired: Whether they belong together one by one.
        tolerated: Share of a's values that may be lost.
    """
    if not a.any():
        return ""
    if not b.any():
        return "b has no value of it"
    lost = int((a & ~b).sum()) if paired else max(0, int((~b).sum()) - int((~a).sum()))
    return f"b lacks {lost} of the {int(a.sum())} values that a has" if lost > tolerated * a.sum() else ""


def _mean(values: FloatArray) -> float:
    return float(values.mean()) if len(values) else np.nan
