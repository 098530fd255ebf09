"""Scores of tracks against truth, above all for the vehicles that the sensor could not see."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class ScoredRun:
    """A run's scores as they are written to its folder.

    Attributes:
        errors: One row per vehicle and step, see ``harness.scoring.errors.error_table``.
        metrics: The nested dictionary of ``metrics.json``, without timing and traffic.
        events: One row per occlusion event, see ``harness.scoring.occlusion.event_table``.
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
    from harness.scoring.score import evaluate, metrics_dict  # noqa: PLC0415

    evaluation = evaluate(truth, detections, tracks, seed=seed)
    return ScoredRun(evaluation.errors, metrics_dict(evaluation.scores), evaluation.events)
