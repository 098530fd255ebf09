"""Whether the expected number of undetected vehicles is right, and better than the mean density."""

from dataclasses import dataclass

import numpy as np

from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import of_whole, ratio
from harness.scoring.metrics.quantity import Columns, Quantity
from mmpf.numerics.arrays import FloatArray, IntArray

NAME = "never_seen"
EDGES = np.array([0.01, 0.03, 0.1, 0.3, 1.0])
"""Expected vehicles a stretch at which the classes of the reliability curve meet."""
LEAST_PROBABILITY = 1e-4


def expected_over_counted_of_runs(column: Columns) -> tuple[FloatArray, FloatArray]:
    """Return the vehicles expected and those counted in each run, both of shape (runs,)."""
    stretches = column(f"{NAME}.stretches")
    return column(f"{NAME}.expected") * stretches, column(f"{NAME}.counted") * stretches


QUANTITIES = (
    Quantity(
        f"{NAME}.log_skill_percent", "undetected vehicles: log score gained over a constant density, %", True,
        weight=f"{NAME}.stretches", least=-np.inf,
    ),
    Quantity(
        f"{NAME}.expected_over_counted", "undetected vehicles: expected over true number", decimals=2, best=1.0,
        pooled=expected_over_counted_of_runs,
    ),
)  # fmt: skip


@dataclass(frozen=True)
class NeverSeenPart:
    """Sums over the stretches of lane of a stretch of a run; those of classes of the curve have shape (6,).

    ``classes`` counts stretches, ``occupied`` those with a vehicle; the losses are of the probability that there is
    one.
    """

    classes: IntArray
    expected: FloatArray
    counted: FloatArray
    expected_squared: float
    expected_times_counted: float
    occupied: int
    log_loss: float
    squared_loss: float


def measure_unseen(evidence: Evidence) -> NeverSeenPart | None:
    """Measure a stretch of a run; None where nobody said what to expect."""
    if evidence.unseen is None:
        return None
    expected, counted = evidence.unseen.expected, evidence.unseen.counted
    of_class = np.searchsorted(EDGES, expected, side="right")
    occupied = counted > 0.0
    probability = np.clip(-np.expm1(-expected), LEAST_PROBABILITY, 1.0 - LEAST_PROBABILITY)
    size = len(EDGES) + 1
    return NeverSeenPart(
        classes=np.bincount(of_class, minlength=size),
        expected=np.bincount(of_class, expected, minlength=size).astype(np.float64),
        counted=np.bincount(of_class, counted, minlength=size).astype(np.float64),
        expected_squared=float((expected**2).sum()),
        expected_times_counted=float((expected * counted).sum()),
        occupied=int(occupied.sum()),
        log_loss=float(-np.log(np.where(occupied, probability, 1.0 - probability)).sum()),
        squared_loss=float(((probability - occupied) ** 2).sum()),
    )


@of_whole
def scores_of_unseen(part: NeverSeenPart) -> dict[str, object]:
    """Return how well the expected number of vehicles without a track fits those that there are.

    Returns:
        Over stretches of lane within range, twice a second: ``expected`` and ``counted``, vehicles a stretch;
        ``expected_over_counted``; ``slope``, that of the line through the origin that takes what is expected to what is
        counted, 1 if right; ``log_skill_percent`` and ``brier_skill_percent``, by how much the logarithmic and the
        squared loss of "somebody is there" are less than those of one probability for all stretches, the best that
        there is in hindsight; ``curve``, the classes of the reliability curve; ``stretches``. Empty where no lanes are
        known or nobody said what to expect.
    """
    stretches, expected, counted = int(part.classes.sum()), part.expected, part.counted
    share = ratio(part.occupied, stretches)
    return {
        "expected": ratio(expected.sum(), stretches),
        "counted": ratio(counted.sum(), stretches),
        "expected_over_counted": ratio(expected.sum(), counted.sum()),
        "slope": ratio(part.expected_times_counted, part.expected_squared),
        "log_skill_percent": _skill(part.log_loss, -stretches * _entropy(share)),
        "brier_skill_percent": _skill(part.squared_loss, stretches * share * (1.0 - share)),
        "curve": [
            {"stretches": int(count), "expected": ratio(mean, count), "counted": ratio(there, count)}
            for count, mean, there in zip(part.classes, expected, counted, strict=True)
        ],
        "stretches": stretches,
    }


def _entropy(share: float) -> float:
    return float(sum(part * np.log(part) for part in (share, 1.0 - share) if part > 0.0))


def _skill(loss: float, usual_loss: float) -> float:
    return 100.0 * (1.0 - ratio(loss, usual_loss))
