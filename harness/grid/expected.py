"""A guess of how long the runs of a grid take."""

from __future__ import annotations

from collections.abc import Sequence

from harness.grid.cells import Cell
from harness.running.expected import LOADING_S, expected_tracking_s, expected_traffic_s


def expected_s(cells: Sequence[Cell], workers: int) -> float:
    """Return the guess in seconds, for so many workers."""
    work_s = sum(expected_traffic_s(c.config) + sum(expected_tracking_s(run.config) for run in c.runs) for c in cells)
    return LOADING_S + work_s / max(1, min(workers, len(cells)))
