"""What the pool asks of its workers and makes of their answers; the workers are threads that play their part."""

import os
import subprocess
import threading
import time
from contextlib import suppress
from multiprocessing.connection import Connection

import pytest

from harness.grid import pool
from harness.grid.grid import GridRequest, plan_grid
from harness.grid.pool import run_cells
from harness.grid.worker import CELL, RUN, STEPPING, CellDone, Finished, Started

ECHO = "tests.harness.stand_ins:echo_tracker"
CELLS = plan_grid(GridRequest(densities="20", seeds="5", trackers=f"{ECHO},{ECHO}+gain=2", duration_s=1.0)).cells


class Played:
    """A process that is none: a thread answers each cell with what its part says."""

    made: list["Played"]

    def __init__(self, part, code: int, complaint: bytes, command, **options) -> None:
        self.command, self.options, self.code, self.killed, self.waits = command, options, code, 0, []
        self.cells = 0
        options["stderr"].write(complaint)
        self.connection = Connection(os.dup(int(command[-1])))
        threading.Thread(target=self._play, args=(part,), daemon=True).start()
        Played.made.append(self)

    def _play(self, part) -> None:
        with suppress(EOFError, OSError):
            while True:
                cell = self.connection.recv()
                self.cells += 1
                if part(cell, self.connection.send, len(Played.made)) == "dies":
                    break
        self.connection.close()

    def kill(self) -> None:
        self.killed += 1

    def wait(self, timeout: float | None = None) -> int:
        self.waits.append(timeout)
        if self.code is None and not self.killed:
            raise subprocess.TimeoutExpired("it", timeout or 0.0)
        return self.code or 0


@pytest.fixture
def played(monkeypatch):
    """Return what lets workers play a part; it returns the list of those that were started."""
    Played.made = []

    def play(part, code: int | None = 0, complaint: bytes = b"") -> list[Played]:
        monkeypatch.setattr(
            pool.subprocess, "Popen", lambda command, **options: Played(part, code, complaint, command, **options)
        )
        return Played.made

    return play


def well(cell, send, _=0) -> None:
    send(Started(CELL))
    for run in cell.runs:
        send(Started(RUN, run.key))
        send(Started(STEPPING, run.key))
        send(Finished(run.key, {"seed": run.config.seed, "variant": run.variant}))
    send(CellDone())


def rows_of(*arguments, **options) -> dict:
    rows = {}

    def on_row(key, row) -> None:
        assert key not in rows
        rows[key] = row

    run_cells(*arguments, on_row=on_row, **options)
    return rows


def test_every_run_is_told_once_and_a_single_worker_does_the_cells_in_their_order(played):
    made = played(well)
    rows = rows_of(CELLS, 1, None)
    assert [(row["seed"], row["variant"]) for row in rows.values()] == [
        (seed, variant) for seed in range(5) for variant in (ECHO, f"{ECHO}+gain=2")
    ]
    assert [(worker.cells, worker.killed) for worker in made] == [(5, 1)]


def test_there_are_as_many_workers_as_asked_for_and_never_more_than_cells(played):
    together = threading.Barrier(3, timeout=10.0)

    def waits(cell, send, _) -> None:
        together.wait()
        well(cell, send)

    made = played(waits)
    rows_of(CELLS[:3], 3, None)
    rows_of(CELLS[:3], 8, None)
    assert [worker.cells for worker in made] == [1] * 6


def test_a_worker_is_replaced_after_so_many_cells(played, monkeypatch):
    monkeypatch.setattr(pool, "CELLS_PER_PROCESS", 2)
    made = played(well)
    assert len(rows_of(CELLS, 1, None)) == 10
    assert [(worker.cells, worker.killed) for worker in made] == [(2, 1), (2, 1), (1, 1)]


def test_traffic_that_takes_too_long_fails_all_runs_of_its_cell(played):
    played(lambda cell, send, _: send(Started(CELL)))
    begin = time.monotonic()
    rows = rows_of(CELLS[:1], 1, 0.05)
    assert {row["error"] for row in rows.values()} == {"timeout: traffic and sensor took longer than 0.05 s"}
    assert list(rows) == [run.key for run in CELLS[0].runs]
    assert all(0.05 <= row["total_s"] <= time.monotonic() - begin for row in rows.values())
    assert time.monotonic() - begin < pool.LONGEST_WAIT_S


@pytest.mark.parametrize("what", [RUN, STEPPING])
def test_a_run_that_takes_too_long_fails_alone_and_another_worker_does_the_rest(played, what):
    def hangs(cell, send, number) -> None:
        if number > 1:
            well(cell, send)
            return
        send(Started(CELL))
        send(Started(what, cell.runs[0].key))

    made = played(hangs)
    first, second = rows_of(CELLS[:1], 1, 0.05).values()
    assert first["error"] == "timeout: the run took longer than 0.05 s"
    assert second == {"seed": 0, "variant": f"{ECHO}+gain=2"}
    assert [(worker.cells, worker.killed) for worker in made] == [(1, 1), (1, 1)]


def test_each_beginning_has_the_whole_time_limit_and_a_worker_without_work_has_none(played):
    def slow(cell, send, _) -> None:
        for key in ("", *(run.key for run in cell.runs)):
            send(Started(RUN if key else CELL, key))
            time.sleep(0.12)
            if key:
                send(Finished(key, {"succeeded": True}))
        send(CellDone())

    played(slow)
    assert all(row == {"succeeded": True} for row in rows_of(CELLS[:1], 1, 0.25).values())


@pytest.mark.parametrize(
    ("code", "complaint", "reason"),
    [
        (3, b"Traceback\n  somewhere\nValueError: no\n\n", "the worker process died (exit code 3: ValueError: no)"),
        (3, b"all \xff in one", "the worker process died (exit code 3: all \ufffd in one)"),
        (0, b"", "the worker process died (exit code 0)"),
        (-9, b"ignored", "the worker process died (signal SIGKILL, out of memory perhaps)"),
        (-11, b"", "the worker process died (signal SIGSEGV)"),
        (None, b"", "the worker process died (it no longer answered)"),
    ],
)
def test_a_worker_that_dies_in_its_second_run_fails_that_alone_and_says_why(played, code, complaint, reason):
    def dies(cell, send, _) -> str:
        first, second = cell.runs
        send(Started(CELL))
        send(Started(RUN, first.key))
        send(Finished(first.key, {"succeeded": True}))
        send(Started(RUN, second.key))
        return "dies"

    made = played(dies, code, complaint)
    first, second = rows_of(CELLS[:1], 1, 60.0).values()
    (worker,) = made
    assert first == {"succeeded": True}
    assert second["error"] == reason
    assert 0.0 <= second["total_s"] < 10.0
    assert worker.waits[0] == pool.LONGEST_WAIT_S
    assert worker.killed == (2 if code is None else 1)


def test_a_worker_that_dies_between_two_runs_fails_none_and_the_rest_is_done_elsewhere(played):
    def dies(cell, send, number) -> str | None:
        if number > 1:
            return well(cell, send)
        send(Started(CELL))
        send(Started(RUN, cell.runs[0].key))
        send(Finished(cell.runs[0].key, {"succeeded": True}))
        return "dies"

    played(dies)
    rows = rows_of(CELLS[:1], 1, None)
    assert list(rows.values()) == [{"succeeded": True}, {"seed": 0, "variant": f"{ECHO}+gain=2"}]


def test_an_error_of_who_takes_the_rows_ends_all_workers(played):
    made = played(well)

    def full(key, row) -> None:
        raise OSError("full")

    with pytest.raises(OSError, match="full"):
        run_cells(CELLS, 2, None, full)
    assert [worker.killed for worker in made] == [1] * len(made)
