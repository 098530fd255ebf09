"""Outcomes of the tracks of hidden vehicles, which explain their errors."""

import numpy as np

from harness.scoring.evidence.errors import HIJACKED, LOST, TRACKED, UNTRACKED
from harness.scoring.gathered import Evidence
from harness.scoring.metrics.parts import of_whole, ratio
from harness.scoring.metrics.quantity import Quantity
from harness.storage.schema import HIDDEN, OUTCOMES
from mmpf.numerics.arrays import IntArray

TRACKED_PERCENT = "hidden_outcomes.tracked_percent"
QUANTITIES = (Quantity(TRACKED_PERCENT, "hidden with their own track, %", True, weight="hidden_outcomes.n"),)


def measure_outcomes(evidence: Evidence) -> IntArray:
    """Count the outcomes of all vehicle-steps hidden, from the first detection on, up to the memory."""
    return count_outcomes(evidence.errors.outcome[evidence.errors.state == HIDDEN])


def count_outcomes(outcome: IntArray) -> IntArray:
    """Count each outcome among hidden vehicle-steps, shape (n,)."""
    return np.bincount(outcome, minlength=len(OUTCOMES))


def hidden_outcomes(counts: IntArray) -> dict[str, float]:
    """Return the shares of the outcomes of hidden vehicle-steps, which were counted along ``OUTCOMES``.

    Returns:
        Their number ``n``, and shares in percent, nan without any: the track that held the vehicle is alive and on no
        other (``tracked``), gone (``lost``), on another vehicle (``hijacked``), or none held it at its last detection
        (``untracked``).
    """
    n = int(counts.sum())
    told = (TRACKED, LOST, HIJACKED, UNTRACKED)
    return {"n": n, **{f"{OUTCOMES[each]}_percent": 100.0 * ratio(counts[each], n) for each in told}}


outcomes_while_hidden = of_whole(hidden_outcomes)
