"""What became of the tracks of hidden vehicles, to read their errors by."""

from __future__ import annotations

import numpy as np

from harness.scoring.errors import HIJACKED, LOST, TRACKED, UNTRACKED
from harness.scoring.evidence import Evidence
from harness.scoring.quantity import Quantity
from harness.sensor.observation import HIDDEN
from mmpf.compute.arrays import IntArray

TRACKED_PERCENT = "hidden_outcomes.tracked_percent"
QUANTITIES = (Quantity(TRACKED_PERCENT, "hidden tracked, %", higher_is_better=True, compared=True),)


def outcomes_while_hidden(evidence: Evidence) -> dict[str, float]:
    """Return the outcomes of all vehicle-steps hidden, from the first detection on, up to the memory."""
    return hidden_outcomes(evidence.errors.outcome[evidence.errors.state == HIDDEN])


def hidden_outcomes(outcome: IntArray) -> dict[str, float]:
    """Count the outcomes of hidden vehicle-steps, shape (n,).

    Returns:
        Their number ``n``, and shares in percent, nan without any: the track that held the vehicle is alive and on no
        other (``tracked``), gone (``lost``), on another vehicle (``hijacked``), or none held it at its last detection
        (``untracked``).
    """

    def percent(code: int) -> float:
        return 100.0 * float((outcome == code).mean()) if len(outcome) else np.nan

    return {
        "n": len(outcome),
        "tracked_percent": percent(TRACKED),
        "lost_percent": percent(LOST),
        "hijacked_percent": percent(HIJACKED),
        "untracked_percent": percent(UNTRACKED),
    }
