"""Compares hidden vehicles with constant-velocity prediction from the state at which each was last seen.

The guess is made by Kalman filters of constant velocity that are told which vehicle each detection is of, so that no
mix-up weighs on it, and what the sensor reports as it is, whatever ``tracker.believes`` makes the trackers believe: all
trackers of one world are held against one guess. Errors are compared on the vehicle-steps that both follow: a tracker
that lets go of difficult vehicles does not look better for it.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from harness.analysis.coasting_ratio import COASTING_TRACKER
from harness.running.evaluate import evaluate
from harness.running.snapshots import SnapshotStream
from harness.scoring.evidence.rules import TIME_TOLERANCE_S
from harness.scoring.metrics.mae import HIDDEN_BINS_S
from harness.scoring.metrics.paired import paired_errors
from harness.storage import run_folder as runfolder
from harness.storage.schema import HIDDEN, VISIBILITY_STATES
from harness.trackers.catalogue import build_tracker

if TYPE_CHECKING:
    import pandas as pd


def coasting_errors(snapshots: SnapshotStream, seed: int) -> pd.DataFrame:
    """Return the error table of coasting over snapshots that are kept."""
    evaluated = evaluate(snapshots, lambda setting: build_tracker(COASTING_TRACKER, setting, {}), seed)
    return evaluated.tables[runfolder.ERRORS]


def against_coasting(errors: pd.DataFrame, coasting: pd.DataFrame) -> dict[str, Any]:
    """Return mean errors of hidden vehicles beside those of coasting on the same rows.

    Returns:
        ``hidden`` over all, ``by_seconds_hidden`` by the time since the last detection: mean absolute longitudinal
        errors ``lon_m`` and ``coasting_lon_m``, None without rows, and their number ``n``.
    """
    both = paired_errors(errors, coasting)
    both = both[both["state"] == VISIBILITY_STATES[HIDDEN]]
    unseen_s = both["seconds_hidden"].to_numpy(dtype=np.float64)
    bins = []
    for from_s, to_s in pairwise(HIDDEN_BINS_S):
        inside = (unseen_s > from_s + TIME_TOLERANCE_S) & (unseen_s <= to_s + TIME_TOLERANCE_S)
        bins.append({"from_s": from_s, "to_s": to_s, **_means(both, inside)})
    return {"hidden": _means(both, np.ones(len(both), dtype=np.bool_)), "by_seconds_hidden": bins}


def _means(both: pd.DataFrame, chosen: npt.NDArray[np.bool_]) -> dict[str, Any]:
    own, coasting = (both[f"lon_error_m_{side}"].to_numpy(dtype=np.float64)[chosen] for side in ("a", "b"))
    if not len(own):
        return {"lon_m": None, "coasting_lon_m": None, "n": 0}
    return {"lon_m": float(np.abs(own).mean()), "coasting_lon_m": float(np.abs(coasting).mean()), "n": len(own)}
