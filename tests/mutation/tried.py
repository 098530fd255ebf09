"""The process in which mutants are tried, one fork each: ``python -m tests.mutation.tried PLAN TOLD`` in their tree.

The plan is a JSON list of names and their tests, the shortest first. The tests are collected once, so that every module
is imported before the first fork, and some must pass without a mutant. What came of each mutant is told
in a line of JSON: the exit code of its tests, ``timeout``, or the signal that ended them.
"""

from __future__ import annotations

import gc
import json
import os
import resource
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

UNDER_TEST = "MUTANT_UNDER_TEST"
QUIET = ("-x", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider", "--hypothesis-seed=0")
BUSY = 10.0
"""Tests may take this many times longer by the clock than by their own time: other programs may want the processor."""


def main() -> int:
    """Try every mutant of a plan that was not tried before."""
    plan, told = json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), Path(sys.argv[2])
    done = {json.loads(line)["mutant"] for line in told.read_text().splitlines()} if told.exists() else set()
    left = [entry for entry in plan if entry["mutant"] not in done]
    os.environ[UNDER_TEST] = ""
    needed = sorted({test for entry in left for test in entry["tests"]})
    if needed:
        pytest.main([*QUIET, "--collect-only", *needed])
        gc.freeze()
        if outcome := tried("", needed[:: len(needed) // 10 + 1], 300):
            sys.stderr.write(f"without any mutant the tests end with {outcome}\n")
            return 1
    with told.open("a", encoding="utf-8") as log:
        for entry in left:
            begin = time.monotonic()
            outcome = tried(entry["mutant"], entry["tests"], entry["limit_s"]) if entry["tests"] else 5
            row = {"mutant": entry["mutant"], "outcome": outcome, "seconds": round(time.monotonic() - begin, 1)}
            log.write(json.dumps(row) + "\n")
            log.flush()
    return 0


def tried(mutant: str, tests: list[str], limit_s: int) -> int | str:
    """Return how the tests end with a mutant in place."""
    child = os.fork()
    if not child:
        os.setsid()
        resource.setrlimit(resource.RLIMIT_CPU, (limit_s + round(time.process_time()), resource.RLIM_INFINITY))
        nowhere = os.open(os.devnull, os.O_RDWR)
        for number in range(3):
            os.dup2(nowhere, number)
        os.environ[UNDER_TEST] = mutant
        code = 3
        try:
            code = int(pytest.main([*QUIET, *tests]))
        finally:
            os._exit(code)
    end = time.monotonic() + BUSY * limit_s
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            break
        if time.monotonic() > end:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return "timeout"
        time.sleep(0.02)
    kill_rest(child)
    if os.WIFSIGNALED(status):
        ended_by = os.WTERMSIG(status)
        return "timeout" if ended_by == signal.SIGXCPU else f"signal {ended_by}"
    return os.WEXITSTATUS(status)


def kill_rest(group: int) -> None:
    """End what a mutant's tests left running."""
    with suppress(ProcessLookupError):
        os.killpg(group, signal.SIGKILL)


if __name__ == "__main__":
    sys.exit(main())
