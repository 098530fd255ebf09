"""What runs a grid's cells here: on stand-in traffic, or not at all."""

from functools import partial
from pathlib import Path

import pandas as pd

from harness.grid.cells import failed_row, finished_row
from harness.grid.worker import Finished, work_on_cell
from harness.running.open import OpenSnapshots
from tests.harness.stand_ins import SteadyTraffic, observing

ECHO = "tests.harness.stand_ins:echo_tracker"
BROKEN = "tests.harness.grid.broken_trackers"
STEADY = observing(SteadyTraffic(steps=8))
METRICS = {"mot": {"hota": 80.0}, "occlusion": {"same_id": 30.0, "events": 40.0}, "run": {"left": "out"}}


class InProcess:
    """Runs cells here, one after the other, by default on stand-in traffic; ``work`` is done on each."""

    def __init__(self, open_snapshots: OpenSnapshots = STEADY, work=None) -> None:
        self.work = work or partial(work_on_cell, open_snapshots=open_snapshots)

    def __call__(self, cells, on_row) -> None:
        def report(message) -> None:
            if isinstance(message, Finished):
                on_row(message.key, message.row)

        for cell in cells:
            self.work(cell, report)


class MadeUp:
    """Runs nothing: every run ends at once, those of one key badly; notes the order of the cells."""

    def __init__(self, bad: str = "", stop_after: int = 1000, why: Exception | None = None) -> None:
        self.bad, self.left, self.why, self.cells, self.rows = bad, stop_after, why, [], 0

    def __call__(self, cells, on_row) -> None:
        self.cells += cells
        for run in (run for cell in cells for run in cell.runs):
            if not self.left:
                raise KeyboardInterrupt
            self.left, self.rows = self.left - 1, self.rows + 1
            broke = run.key == self.bad
            on_row(run.key, failed_row(run, "it broke", 1.5, self.why) if broke else finished_row(run, METRICS, 2.5))


def is_timing(column: str) -> bool:
    """Whether a column holds wall time, which differs between runs of the same configuration."""
    return column == "total_s" or (column.startswith("timing.") and column != "timing.steps")


def table_of(folder: Path) -> pd.DataFrame:
    table = pd.read_parquet(folder / "runs.parquet")
    return table[[column for column in table if not is_timing(column)]]
