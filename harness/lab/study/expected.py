"""A guess of how long a study takes."""

from __future__ import annotations

from collections.abc import Callable

from harness.common.durations import say_roughly

RECORDING_S = 8.0
"""Processor time of a recording."""
PREDICTION_S = 1e-5
"""Processor time of a particle of a case of a model."""


def say_roughly_predicted(say: Callable[[str], object], recordings: int, predictions: int, more_s: float = 0.0) -> None:
    """Say how long it will take.

    Args:
        say: Told the line.
        recordings: Recordings of simulated traffic.
        predictions: Cases times particles of all models.
        more_s: What else takes processor time.
    """
    what = f"the study, less if its {recordings} recordings are there already"
    say_roughly(say, RECORDING_S * recordings + PREDICTION_S * predictions + more_s, what)
