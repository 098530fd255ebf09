"""One worker process: simulates a cell, runs every tracker on it, and reports each row.

A process of its own because libsumo holds one simulation a process, and because only a process can be stopped when a
run hangs.

Each row compares hidden vehicles with constant-velocity prediction from the state at which each was last seen. The
guess is made by Kalman filters of constant velocity that are told which vehicle each detection is of, so that no mix-up
weighs on it, and what the sensor reports as it is, whatever ``tracker.believes`` makes the trackers believe: all
trackers of one world are held against one guess. Errors are compared on the vehicle-steps that both follow: a tracker
that lets go of difficult vehicles does not look better for it.
"""

import os
import queue
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from multiprocessing.connection import Connection
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from harness.analysis.coasting_ratio import COASTING_TRACKER
from harness.config.model import RunConfig, TrafficConfig
from harness.grid.cells import Cell, PlannedRun, command_of, failed_row, finished_row
from harness.running.evaluate import evaluate, evaluation_of, write_run
from harness.running.open import OpenSnapshots, open_snapshots, simulate
from harness.running.snapshots import SnapshotStream
from harness.scoring.evidence.rules import TIME_TOLERANCE_S
from harness.scoring.metrics.mae import HIDDEN_BINS_S
from harness.scoring.metrics.paired import paired_errors
from harness.scoring.metrics.scarce import check_scored
from harness.storage import run_folder as runfolder
from harness.storage.grid_folder import Row
from harness.storage.schema import HIDDEN, VISIBILITY_STATES
from harness.trackers.catalogue import build_tracker
from harness.truth.frame import Frame, TruthSource
from harness.truth.network.network import Network

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
            report(Finished(run.key, failed_row(run, _reason(error), perf_counter() - begin, error)))
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
        check_scored(evaluated.scores, evaluated.steps, "net" if run.config.replay is None else "replay")
        total_s = perf_counter() - begin
        held_against = against_coasting(evaluated.tables[runfolder.ERRORS], coasting)
        metrics = evaluated.metrics(run.config, {**snapshots.about, "against_coasting": held_against}, total_s)
        if keep_in is not None:
            command, inputs = command_of(run.config), snapshots.hashes()
            write_run(keep_in / run.key, evaluated, metrics, run.config, command, inputs)
        return finished_row(run, metrics, total_s)
    except Exception as error:
        return failed_row(run, _reason(error), perf_counter() - begin, error)


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


class RememberedTraffic:
    """Opens snapshots as ``open_snapshots`` does; the frames of the traffic simulated last are kept, and played again.

    Frames are frozen, and a simulation does not depend on who looks at it, so that the snapshots are the same.
    """

    def __init__(self) -> None:
        """Prepare to open snapshots; nothing is remembered yet."""
        self._key: tuple[TrafficConfig, int, float] | None = None
        self._last: _Noted | None = None

    def __call__(self, config: RunConfig) -> SnapshotStream:
        """Return the snapshots that the configuration describes; see ``open_snapshots``."""
        return open_snapshots(config, simulate=self._simulate)

    def _simulate(self, network: Network, traffic: TrafficConfig, seed: int, reach_m: float) -> TruthSource:
        key = traffic, seed, reach_m
        if self._last is None or self._key != key or not self._last.is_whole:
            self._last = None
            self._key, self._last = key, _Noted(simulate(network, traffic, seed, reach_m))
        return self._last


class _Noted:
    """A simulation whose frames are noted as they are yielded, and played again once all were."""

    def __init__(self, truth: TruthSource) -> None:
        self.road, self.step_s, self.expected_steps = truth.road, truth.step_s, truth.expected_steps
        self.close, self.is_whole = truth.close, False
        self._truth, self._frames = truth, list[Frame]()

    def frames(self) -> Iterator[Frame]:
        if self.is_whole:
            yield from self._frames
            return
        for frame in self._truth.frames():
            self._frames.append(frame)
            yield frame
        self.is_whole = True
