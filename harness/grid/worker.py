"""One worker process: simulates a cell, runs every tracker on it, and reports each row.

A process of its own because libsumo holds one simulation a process, and because only a process can be stopped when a
run hangs.
"""

from __future__ import annotations

import os
import queue
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from harness.grid.cells import Cell, PlannedRun
from harness.grid.coasting import against_coasting, coasting_errors
from harness.grid.rerun import command_of
from harness.grid.result_rows import failed_row, finished_row
from harness.running.evaluate import evaluation_of, write_run
from harness.running.open import OpenSnapshots, open_snapshots
from harness.running.remembered import RememberedTraffic
from harness.running.snapshots import SnapshotStream
from harness.scoring.metrics.scarce import check_scored
from harness.storage import run_folder as runfolder
from harness.storage.grid_rows import Row

if TYPE_CHECKING:
    import pandas as pd


CELL, RUN, STEPPING = "cell", "run", "stepping"


@dataclass(frozen=True)
class Started:
    """A worker begins something that may take no longer than the time limit.

    Attributes:
        what: ``cell``: the traffic; ``run``: a run; ``stepping``: that run's first step is done and kernels compiled.
    """

    what: str
    key: str = ""


@dataclass(frozen=True)
class Finished:
    """A run ended, well or not; ``row`` is its row."""

    key: str
    row: Row


@dataclass(frozen=True)
class CellDone:
    """A cell is done; the worker waits for the next."""


Message = Started | Finished | CellDone
Report = Callable[[Message], None]


def work_on_cell(cell: Cell, report: Report, open_snapshots: OpenSnapshots = open_snapshots) -> None:
    """Simulate a cell's traffic once and run every tracker over it; failures are rows."""
    report(Started(CELL))
    begin = perf_counter()
    try:
        snapshots = open_snapshots(cell.config).kept()
        coasting = coasting_errors(snapshots, cell.config.seed)
    except Exception as error:
        for run in cell.runs:
            report(Finished(run.key, failed_row(run, _reason(error), perf_counter() - begin)))
    else:
        for run in cell.runs:
            report(Started(RUN, run.key))
            on_first_step = partial(report, Started(STEPPING, run.key))
            report(Finished(run.key, _run_over(snapshots, run, on_first_step, coasting, cell.keep_in)))
    report(CellDone())


def _run_over(
    snapshots: SnapshotStream,
    run: PlannedRun,
    on_first_step: Callable[[], None],
    coasting: pd.DataFrame,
    keep_in: Path | None,
) -> Row:
    """Return the row of one tracker, which is compared with the errors of coasting over the same snapshots."""
    begin = perf_counter()
    try:
        evaluation = evaluation_of(run.config, snapshots)
        evaluation.follow((lambda *_: on_first_step() if evaluation.steps == 1 else None,))
        evaluated = evaluation.finish()
        check_scored(evaluated.scores, evaluated.steps)
        total_s = perf_counter() - begin
        held_against = against_coasting(evaluated.tables[runfolder.ERRORS], coasting)
        metrics = evaluated.metrics(run.config, {**snapshots.about, "against_coasting": held_against}, total_s)
        if keep_in is not None:
            write_run(keep_in / run.key, evaluated, metrics, run.config, command_of(run.config))
        return finished_row(run, metrics, total_s)
    except Exception as error:
        return failed_row(run, _reason(error), perf_counter() - begin)


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def main() -> None:
    """Work on cells of a stress test; see ``serve``."""
    open_snapshots = RememberedTraffic()
    serve(lambda cell, report: work_on_cell(cell, report, open_snapshots))


def serve(work: Callable[[Cell, Report], None]) -> None:
    """Work on the cells that come through the connection, whose file descriptor is the argument, until it closes."""
    connection = Connection(int(sys.argv[1]))
    cells: queue.SimpleQueue[Cell] = queue.SimpleQueue()
    threading.Thread(target=_receive, args=(connection, cells), daemon=True).start()
    while True:
        work(cells.get(), connection.send)


def _receive(connection: Connection, cells: queue.SimpleQueue[Cell]) -> None:
    """Pass cells on; leave at once, in the middle of a run too, when the other end is gone."""
    while True:
        try:
            cells.put(connection.recv())
        except (EOFError, OSError):
            os._exit(0)
