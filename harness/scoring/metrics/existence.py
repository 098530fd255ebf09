"""Whether a track's stated existence is the probability that it is a vehicle."""

from dataclasses import dataclass
from functools import partial

import numpy as np

from harness.scoring.evidence.matching import gate_match
from harness.scoring.evidence.sequence import tracks_in_sight
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import of_whole, ratio
from harness.scoring.metrics.quantity import Columns, Quantity
from mmpf.numerics.arrays import FloatArray, IntArray

NAME = "existence_calibration"
DECILES = 10
LEAST_TRACK_STEPS = 200
"""Track-steps from which a tenth of the stated existence is judged."""
LEAST_POOLED = 1000
"""Likewise of several runs together."""


def gap_of_runs(column: Columns, largest: bool) -> tuple[FloatArray, FloatArray]:
    """Return sums and weights of runs, both of shape (runs,), whose ratio is the largest or mean gap of all together.

    What is stated and what is there are summed over runs before they are compared, tenth by tenth. The mean of each
    run's own largest gap is well above 0 for a perfect tracker too: of few track-steps in a tenth, chance is the gap.
    """
    steps, stated, observed = (
        np.nan_to_num([column(f"{NAME}.deciles.{k}.{name}") for k in range(DECILES)])
        for name in ("n", "stated", "observed")
    )
    off = steps * (stated - observed)
    total, size = off.sum(axis=1), steps.sum(axis=1)
    if not largest:
        return np.sign(total) @ off, steps.sum(axis=0)
    worst = np.where(size >= LEAST_POOLED, np.abs(total) / np.maximum(size, 1.0), -1.0).argmax()
    return np.sign(total[worst]) * off[worst], steps[worst] * float(size[worst] >= LEAST_POOLED)


QUANTITIES = (
    Quantity(
        f"{NAME}.largest_gap", "existence probability in sight: largest error, percentage points",
        heading="existence gap", pooled=partial(gap_of_runs, largest=True),
    ),
    Quantity(
        f"{NAME}.mean_gap", "existence probability in sight: mean error, percentage points",
        weight=f"{NAME}.n", pooled=partial(gap_of_runs, largest=False),
    ),
    Quantity(f"{NAME}.brier", "existence probability in sight: Brier score", decimals=3, weight=f"{NAME}.n"),
)  # fmt: skip


@dataclass(frozen=True)
class ExistencePart:
    """Sums over the reported tracks in sight in a stretch, by tenths of the stated existence, shape (10,).

    ``real`` counts track-steps that have a vehicle of their own within the gate; ``squared`` is the sum over all tenths
    of the squared difference of what is stated and that.
    """

    count: IntArray
    stated: FloatArray
    real: IntArray
    squared: float


def measure_existence(evidence: Evidence) -> ExistencePart:
    """Measure a stretch."""
    rows, pairs = evidence.rows, evidence.pairs
    stated = rows.tracks.existence
    judged = np.flatnonzero(tracks_in_sight(rows) & ~rows.tracks.unknowable & np.isfinite(stated))
    real = np.zeros(len(rows.tracks), dtype=bool)
    real[gate_match(pairs, np.ones(len(rows.truth), dtype=bool)).track] = True
    says, is_real = stated[judged], real[judged]
    # 0.3 times ten is more than three by rounding: the edges are those that people write.
    decile = np.clip(np.searchsorted(np.arange(1, DECILES) / DECILES, says, side="right"), 0, DECILES - 1)
    return ExistencePart(
        count=np.bincount(decile, minlength=DECILES).astype(np.int64),
        stated=np.bincount(decile, says, minlength=DECILES).astype(np.float64),
        real=np.bincount(decile[is_real], minlength=DECILES).astype(np.int64),
        squared=float(((says - is_real) ** 2).sum()),
    )


@of_whole
def existence_calibration(part: ExistencePart) -> dict[str, object]:
    """Hold stated existences against what is there.

    Over the ``n`` track-steps of reported tracks in sight (detections decide, see ``tracks_in_sight``) that state one.
    A track-step is real if it has a true vehicle, visible or not, in the best assignment within the gate: of two tracks
    on one vehicle one is not real.

    Returns:
        ``deciles``: for each tenth of the stated existence ``from`` and ``to`` in [0, 1], ``n`` track-steps, and in
        percent the mean ``stated`` and the ``observed`` share that is real. ``largest_gap``: the largest absolute
        difference of the two among tenths with at least 200 track-steps, in points. ``mean_gap``: its mean over all
        tenths, weighted by track-steps. ``brier``: mean squared difference of the stated probability and what is there,
        0 is best. nan where there is nothing to tell.
    """
    count, stated, real = part.count, part.stated, part.real
    deciles = [
        {
            "from": k / DECILES,
            "to": (k + 1) / DECILES,
            "n": int(count[k]),
            "stated": 100.0 * ratio(stated[k], count[k]),
            "observed": 100.0 * ratio(real[k], count[k]),
        }
        for k in range(DECILES)
    ]
    many = count >= LEAST_TRACK_STEPS
    gaps = np.abs(stated[many] - real[many]) / count[many]
    return {
        "largest_gap": 100.0 * float(gaps.max()) if len(gaps) else np.nan,
        "mean_gap": 100.0 * ratio(np.abs(stated - real).sum(), count.sum()),
        "brier": ratio(part.squared, float(count.sum())),
        "n": int(count.sum()),
        "deciles": deciles,
    }
