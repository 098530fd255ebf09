"""A guess of how long the runs of a grid take."""

from __future__ import annotations

from collections.abc import Sequence

from harness.grid.cells import Cell
from harness.running.expected import LOADING_S, expected_tracking_s, expected_traffic_s


def expected_s(cells: Sequence[Cell], workers: int) -> float:
    """Return the guess in seconds, for so many workers."""
    return LOADING_S + sum(map(work_s, cells)) / max(1, min(workers, len(cells)))


def work_s(cell: Cell) -> float:
    """Return the guess for one worker and a cell, seconds."""
    return expected_traffic_s(cell.config) + sum(expected_tracking_s(run.config) for run in cell.runs)
