"""A pool of worker processes that are watched, and replaced when they die or hang; and the queue of cells for them."""

import os
import pickle
import signal
import subprocess
import sys
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from time import monotonic
from typing import IO

from harness.grid.cells import Cell, CellTraffic, PlannedRun, failed_row
from harness.grid.worker import CELL, CellDone, Finished, Message, Started
from harness.storage.grid_folder import Row

OnRow = Callable[[str, Row], None]
WORKER = "harness.grid.worker"
"""Module of those who work on a stress test."""

# Numerical libraries must not start threads of their own: the workers use all cores already.
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS", "NUMEXPR_NUM_THREADS"), "1"
)
CELLS_PER_PROCESS = 50
"""After so many cells a worker is replaced, so that nothing that a library leaks adds up."""
LONGEST_WAIT_S = 5.0


def run_cells(
    cells: Sequence[Cell], workers: int, timeout_s: float | None, on_row: OnRow, worker_module: str = WORKER
) -> None:
    """Run all cells in worker processes.

    Args:
        timeout_s: Longest time for the traffic of a cell, and for the steps of a run; None for no limit.
        on_row: Called with the key and row of every run once, in the order in which they end.
    """
    waiting = CellQueue(cells)
    pool: list[_Worker] = []
    try:
        while waiting or pool:
            while waiting and len(pool) < workers:
                pool.append(_Worker(timeout_s, worker_module))
                pool[-1].give(waiting.take(None))
            left_s = [worker.deadline - monotonic() for worker in pool if worker.deadline is not None]
            wait([worker.connection for worker in pool], max(0.0, min([LONGEST_WAIT_S, *left_s])))
            for worker in tuple(pool):
                worker.take_in(on_row)
                if worker.idle and waiting and worker.cells < CELLS_PER_PROCESS:
                    worker.give(waiting.take(worker.traffic))
                elif worker.idle or worker.gone:
                    pool.remove(worker)
                    worker.stop()
                    if worker.rest:
                        waiting.put_back(replace(worker.cell, runs=tuple(worker.rest.values())))
    finally:
        for worker in pool:
            worker.stop()


@dataclass
class _Worker:
    """A worker process as its owner sees it."""

    timeout_s: float | None
    module: str
    cell: Cell = field(init=False)
    connection: Connection = field(init=False)
    process: subprocess.Popen[bytes] = field(init=False)
    rest: dict[str, PlannedRun] = field(default_factory=dict)
    cells: int = 0
    traffic: CellTraffic | None = None
    idle: bool = True
    gone: bool = False
    deadline: float | None = None
    _now: Started = field(default_factory=lambda: Started(CELL))
    _since: float = 0.0
    _complaints: IO[bytes] = field(default_factory=tempfile.TemporaryFile)

    def __post_init__(self) -> None:
        self.connection, theirs = Pipe()
        paths = os.pathsep.join(path for path in sys.path if path)
        aside = "from harness.common.watching import set_folder_aside as aside; aside()"
        self.process = subprocess.Popen(
            [sys.executable, "-c", f"{aside}; from {self.module} import main; main()", str(theirs.fileno())],
            env=os.environ | ONE_THREAD | {"PYTHONPATH": paths},
            pass_fds=[theirs.fileno()],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=self._complaints,
            start_new_session=True,
        )
        theirs.close()

    def give(self, cell: Cell) -> None:
        """Send a cell to work on."""
        self.cell = cell
        self.rest = {run.key: run for run in cell.runs}
        self.cells += 1
        self.traffic = cell.traffic
        self.idle = False
        self._now, self._since = Started(CELL), monotonic()
        # One that died is noticed when its answer is waited for.
        with suppress(OSError):
            self.connection.send(cell)

    def take_in(self, on_row: OnRow) -> None:
        """Take in what the worker reported; notice when it died or has taken too long."""
        while True:
            # What `on_row` raises, such as a full disk's error, must not be taken for a worker's death.
            try:
                message = self.connection.recv() if self.connection.poll() else None
            except (EOFError, OSError, pickle.UnpicklingError):
                self._give_up(f"the worker process died ({self._death()})", on_row)
                return
            if message is None:
                break
            self._take(message, on_row)
        if self.deadline is not None and not self.idle and monotonic() > self.deadline:
            what = "traffic and sensor" if self._now.what == CELL else "the run"
            self._give_up(f"timeout: {what} took longer than {self.timeout_s:g} s", on_row)

    def stop(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        self.connection.close()
        self._complaints.close()

    def _take(self, message: Message, on_row: OnRow) -> None:
        match message:
            case Started():
                self._now, self._since = message, monotonic()
                self.deadline = None if self.timeout_s is None else self._since + self.timeout_s
            case Finished(key, row):
                del self.rest[key]
                on_row(key, row)
            case CellDone():
                self.idle = True
                self.deadline = None

    def _give_up(self, reason: str, on_row: OnRow) -> None:
        """Fail the run in progress, or all that wait for the traffic; other workers do the rest."""
        self.gone = True
        failed = [self._now.key] if self._now.key in self.rest else list(self.rest) if not self._now.key else []
        for key in failed:
            on_row(key, failed_row(self.rest.pop(key), reason, monotonic() - self._since))

    def _death(self) -> str:
        try:
            code = self.process.wait(LONGEST_WAIT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
            return "it no longer answered"
        if code >= 0:
            self._complaints.seek(0)
            last = self._complaints.read().decode(errors="replace").strip().rpartition("\n")[2]
            return f"exit code {code}{': ' if last else ''}{last}"
        hint = ", out of memory perhaps" if -code == signal.SIGKILL else ""
        return f"signal {signal.Signals(-code).name}{hint}"


class CellQueue:
    """Hands out cells so that a worker reuses the traffic that it remembers where possible."""

    def __init__(self, cells: Iterable[Cell]) -> None:
        """Take in the cells; traffic is begun in their order."""
        self._waiting: dict[CellTraffic, deque[Cell]] = {}
        self._begun: set[CellTraffic] = set()
        for cell in cells:
            self._waiting.setdefault(cell.traffic, deque()).append(cell)

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def take(self, remembered: CellTraffic | None) -> Cell:
        """Take the next cell: of the traffic that the worker remembers, else of any that none has begun, else any."""
        traffic = remembered
        if traffic not in self._waiting:
            new = (each for each in self._waiting if each not in self._begun)
            traffic = next(new, None) or max(self._waiting, key=lambda each: len(self._waiting[each]))
        self._begun.add(traffic)
        cell = self._waiting[traffic].popleft()
        if not self._waiting[traffic]:
            del self._waiting[traffic]
        return cell

    def put_back(self, cell: Cell) -> None:
        """Let a cell wait again, before the others of its traffic."""
        self._waiting.setdefault(cell.traffic, deque()).appendleft(cell)
