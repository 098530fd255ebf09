"""Scores on real detections: identity after gaps in detection, for moving and parked vehicles.

Only where the source tells parked vehicles from others. A gap is an occlusion event (``events``); that
of a parked vehicle asks less of a tracker, which finds it where it was.
"""

from dataclasses import dataclass

import numpy as np

from harness.scoring.evidence.errors import scored_rows
from harness.scoring.evidence.rules import TIME_TOLERANCE_S
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import of_whole, ratio
from harness.scoring.metrics.quantity import Quantity, of_kinds
from harness.storage.schema import HIDDEN
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

NAME = "gaps"
ALL, MOVING, PARKED = KINDS = ("all", "moving", "parked")
LONG_S = 1.0


QUANTITIES = of_kinds(
    NAME, {ALL: "", MOVING: f", {MOVING}", PARKED: f", {PARKED}"},
    Quantity("same_id", "same identity after gaps{}, %", True, weight="events", scale=100.0),
    Quantity("long_same_id", "same identity after gaps of 1 s and more{}, %", True, weight="long_events", scale=100.0),
    Quantity("position_m", "position error in sight{}, m", decimals=2, weight="n"),
)  # fmt: skip


@dataclass(frozen=True)
class GapsPart:
    """Counts of moving and of parked vehicles, shape (2,): gaps, and vehicle-steps in sight that are ``followed``.

    ``same_id`` counts the gaps after which a vehicle has its old track, ``error_sum`` adds up distances from tracks.
    """

    events: IntArray
    same_id: IntArray
    long_events: IntArray
    long_same_id: IntArray
    followed: IntArray
    error_sum: FloatArray


def measure_gaps(evidence: Evidence) -> GapsPart | None:
    """Count in a stretch; None where the source does not tell parked vehicles from others."""
    rows, events, errors = evidence.rows, evidence.events, evidence.errors
    parked = rows.truth.parked
    if parked is None:
        return None
    of_event = parked[events.onset_row]
    is_long = events.duration_s >= LONG_S - TIME_TOLERANCE_S
    followed = errors.tracked & (errors.state != HIDDEN)
    of_kept = parked[scored_rows(rows, evidence.history)][followed]
    error_m = np.hypot(errors.absolute[followed, 0], errors.absolute[followed, 1])
    return GapsPart(
        events=_count(of_event),
        same_id=_count(of_event[events.same_id]),
        long_events=_count(of_event[is_long]),
        long_same_id=_count(of_event[is_long & events.same_id]),
        followed=_count(of_kept),
        error_sum=np.bincount(of_kept.astype(np.int64), error_m, minlength=2).astype(np.float64),
    )


@of_whole
def scores_after_gaps(part: GapsPart) -> dict[str, object]:
    """Return the scores of all, of moving and of parked vehicles.

    Returns:
        For each of ``KINDS``: ``events``, gaps of half a second to ten in a vehicle's detections, of which ``same_id``
        end with the old track on it, ``same_id_percent``; ``long_events``, ``long_same_id`` and
        ``long_same_id_percent`` of gaps of a second and more; ``position_m``, mean distance of the tracks of vehicles
        in sight over the ``n`` vehicle-steps followed. Empty where nobody tells who is parked.
    """
    table: dict[str, object] = {}
    for kind, chosen in zip(KINDS, ([0, 1], [0], [1]), strict=True):
        counts = {
            name: int(getattr(part, name)[chosen].sum())
            for name in ("events", "same_id", "long_events", "long_same_id", "followed")
        }
        n = counts.pop("followed")
        table[kind] = {
            **counts,
            "same_id_percent": ratio(100.0 * counts["same_id"], counts["events"]),
            "long_same_id_percent": ratio(100.0 * counts["long_same_id"], counts["long_events"]),
            "position_m": ratio(part.error_sum[chosen].sum(), n),
            "n": n,
        }
    return table


def _count(parked: BoolArray) -> IntArray:
    return np.bincount(parked.astype(np.int64), minlength=2)
