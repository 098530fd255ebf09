"""Computes the scores of a run, stretch by stretch."""

from typing import Any

import pandas as pd

from harness.scoring.driving.asked import DriverSetup
from harness.scoring.driving.brakings import braking_table, command_table
from harness.scoring.evidence.events import event_table
from harness.scoring.gathered import gather
from harness.scoring.metrics.registry import Totals
from harness.storage import run_folder as runfolder


class RunScorer:
    """Scores a run that comes stretch by stretch, each of one or more whole episodes, without keeping them.

    The numbers of a run in several stretches differ from the same run's in one piece by the rounding of sums and by the
    order in which vehicles are resampled.
    """

    def __init__(self, seed: int = 0, driven: DriverSetup | None = None) -> None:
        """Begin; the seed is that of the bootstrap intervals, the driver is asked by truth and by tracks."""
        self._totals = Totals(seed)
        self._driven = driven

    @property
    def takes_stretches(self) -> bool:
        """Whether a run may come in more than one stretch: every metric is in parts."""
        return not self._totals.whole_run_needed()

    def add(
        self,
        truth: pd.DataFrame,
        detections: pd.DataFrame,
        tracks: pd.DataFrame,
        unseen: pd.DataFrame | None = None,
    ) -> dict[str, pd.DataFrame]:
        """Measure the next stretch and return its tables by file; see ``harness.storage.schema``.

        Args:
            truth: The table of that name, as the next two.
            detections: Likewise.
            tracks: Likewise.
            unseen: One row per stretch of lane and moment with the vehicles expected there without a track; None for
                none.

        Raises:
            ValueError: The tables contradict each other or hold unknown states.
        """
        evidence = gather(truth, detections, tracks, self._totals.seed, self._driven, unseen)
        self._totals.add(evidence)
        asked, found, rows = evidence.asked, evidence.brakings, evidence.rows
        tables = {
            runfolder.ERRORS: evidence.error_table,
            runfolder.EVENTS: event_table(truth, rows, evidence.events),
        }
        if asked is not None and found is not None:
            tables[runfolder.BRAKINGS] = braking_table(truth, found, asked, rows, evidence.history)
            tables[runfolder.COMMANDS] = command_table(asked, rows)
        return tables

    def metrics(self) -> dict[str, Any]:
        """Return the nested dictionary of ``metrics.json`` over all stretches, without timing and traffic."""
        return self._totals.metrics()
