"""Scores of tracks against truth, above all for the vehicles that the sensor could not see.

Conventions of all scores: the ego is no vehicle; tentative tracks are not reported and not scored; accuracies and
shares are in percent; errors are estimate minus truth; vehicles and tracks of different episodes have nothing to do
with each other; a vehicle beyond the sensor's range is neither missed nor is the track on it false, and the same holds
at and beyond the edge of the road that the truth's source knows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from harness.scoring.settings import ScoringSettings

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ScoredRun:
    """A run's scores as they are written to its folder.

    Attributes:
        errors: One row per vehicle and step, see ``harness.scoring.errors.error_table``.
        metrics: The nested dictionary of ``metrics.json``, without timing and traffic.
        events: One row per occlusion event, see ``harness.scoring.events.event_table``.
    """

    errors: pd.DataFrame
    metrics: dict[str, Any]
    events: pd.DataFrame


def score_run(truth: pd.DataFrame, detections: pd.DataFrame, tracks: pd.DataFrame, seed: int = 0) -> ScoredRun:
    """Score a run by the published rules.

    Args:
        truth: One row per vehicle and step.
        detections: One row per detection.
        tracks: One row per track and step.
        seed: Seed of the bootstrap intervals.

    Returns:
        The errors, metrics and occlusion events.

    Raises:
        ValueError: The tables contradict each other or hold unknown states.
    """
    scorer = RunScorer(seed)
    errors, events = scorer.add(truth, detections, tracks)
    return ScoredRun(errors, scorer.metrics(), events)


class RunScorer:
    """Scores a run that comes stretch by stretch, each of one or more whole episodes, without keeping them.

    A run that is a single stretch gets the numbers of ``score_run``; those of several differ from the same run's in
    one piece by the rounding of sums and by the order in which vehicles are resampled.
    """

    def __init__(self, seed: int = 0) -> None:
        """Begin; the seed is that of the bootstrap intervals."""
        from harness.scoring.metrics import Totals  # noqa: PLC0415  pandas is slow to import
        from harness.scoring.parts import Basis  # noqa: PLC0415

        self._basis = Basis(ScoringSettings(), seed)
        self._totals = Totals(self._basis)

    @property
    def takes_stretches(self) -> bool:
        """Whether a run may come in more than one stretch: every metric is in parts."""
        return not self._totals.whole_run_needed()

    def add(
        self, truth: pd.DataFrame, detections: pd.DataFrame, tracks: pd.DataFrame
    ) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Measure the next stretch; return its errors and its occlusion events. Errors are those of ``score_run``."""
        from harness.scoring.events import event_table  # noqa: PLC0415
        from harness.scoring.evidence import gather  # noqa: PLC0415

        evidence = gather(truth, detections, tracks, self._basis.settings, self._basis.seed)
        self._totals.add(evidence)
        return evidence.error_table, event_table(truth, evidence.rows, evidence.events)

    def metrics(self) -> dict[str, Any]:
        """Return the nested dictionary of ``metrics.json`` over all stretches, without timing and traffic."""
        return self._totals.metrics()
