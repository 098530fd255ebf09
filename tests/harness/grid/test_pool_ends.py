"""What the pool does when something around the workers fails; the workers themselves are real."""

from __future__ import annotations

import errno
import sys
import time

import pytest

from harness.grid.grid import GridRequest, plan_grid
from harness.grid.pool import run_cells

REQUEST = GridRequest(densities="20", seeds="1", trackers="tests.harness.stand_ins:echo_tracker", duration_s=1.0)


def test_an_error_of_who_takes_the_rows_is_not_taken_for_a_workers_death(monkeypatch):
    def full(key: str, row: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patched:
        worker = (
            "import sys, time; from multiprocessing.connection import Connection;"
            "from harness.grid.worker import Finished; c = Connection(int(sys.argv[-1]));"
            "c.send(Finished(c.recv().runs[0].key, {})); time.sleep(900)"
        )
        _work_as(patched, worker)
        begin = time.monotonic()
        with pytest.raises(OSError, match="No space left"):
            run_cells(plan_grid(REQUEST).cells, 1, None, full)
        assert time.monotonic() - begin < 450.0


@pytest.mark.parametrize(
    ("worker", "reason"),
    [
        ("raise SystemExit(7)", "the worker process died (exit code 7)"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGKILL)", "died (signal SIGKILL, out of memory perhaps)"),
        ("import os, sys, time; os.close(int(sys.argv[-1])); time.sleep(60)", "died (it no longer answered)"),
    ],
)
def test_workers_that_die_at_once_are_failed_rows_and_no_endless_loop(worker, reason, monkeypatch):
    monkeypatch.setattr("harness.grid.pool.LONGEST_WAIT_S", 0.3)
    _work_as(monkeypatch, worker)
    rows = {}
    run_cells(plan_grid(REQUEST).cells, 1, None, rows.__setitem__)
    assert [row["succeeded"] for row in rows.values()] == [False]
    assert reason in next(iter(rows.values()))["error"]


def _work_as(monkeypatch, script: str) -> None:
    """Let workers run a script in the place of the worker's main."""
    import subprocess  # noqa: PLC0415

    real = subprocess.Popen

    def popen(command, **options):
        return real([sys.executable, "-c", script, command[-1]], **options)

    monkeypatch.setattr("harness.grid.pool.subprocess.Popen", popen)
