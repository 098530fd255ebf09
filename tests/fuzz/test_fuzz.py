"""Spoilt inputs of every kind end in time, in bounds, with a documented exit code and without a traceback.

``HARNESS_FUZZ_CASES`` and ``HARNESS_FUZZ_SEED`` set how many there are and which, ``HARNESS_FUZZ_FIRST`` at which of
them to begin. To the file that ``HARNESS_FUZZ_REPORT`` names a line of JSON is added for each, with what was changed:
whether an accepted one is nonsense is for a reader to say.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest

from harness import exitcodes

ROOT = Path(__file__).parents[2]
CASES, SEED = int(os.environ.get("HARNESS_FUZZ_CASES", "36")), int(os.environ.get("HARNESS_FUZZ_SEED", "1"))
FIRST = int(os.environ.get("HARNESS_FUZZ_FIRST", "0"))
LONGEST_S = 60.0
STARTING_S = 120.0
BUSY = 10.0
"""A case may take this many times longer by the clock than by its own time: other programs may want the processor."""


@dataclass
class Case:
    """What became of one input."""

    number: int
    kind: str
    command: list[str]
    spoilt: list[str]
    code: int | None = None
    seconds: float = 0.0
    stderr: str = ""

    def fault(self) -> str:
        """Return what is wrong with how it ended; empty if nothing is."""
        if self.code is None:
            return self.stderr or "the process died"
        if "Traceback" in self.stderr:
            return "traceback"
        if self.code not in exitcodes.MEANINGS or self.code == exitcodes.INTERNAL:
            return f"exit code {self.code}"
        lines = [line for line in self.stderr.splitlines() if line.startswith("error:")]
        if self.code == exitcodes.WRONG_INPUT and len(lines) != 1:
            return f"{len(lines)} lines of error"
        return ""


def rows_of(path: Path) -> list[dict]:
    return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []


def processor_s(process: int) -> float:
    """Return the processor time that a process has had; 0 once it is gone."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def run_cases(folder: Path) -> list[Case]:
    """Run all cases in child processes: one that hangs or dies costs its case, and another goes on behind it."""
    cases: dict[int, Case] = {}
    first, child_number = FIRST, 0
    while first < FIRST + CASES:
        told = folder / f"told-{child_number}.jsonl"
        child_number += 1
        command = [sys.executable, "-m", "tests.fuzz.child", str(SEED), str(first), str(FIRST + CASES), str(told)]
        with (folder / "child.stderr").open("wb") as complaints:
            child = subprocess.Popen(
                command, cwd=ROOT, stderr=complaints, env={**os.environ, "OMP_NUM_THREADS": "1"}, start_new_session=True
            )
        size, since, worked_s = -1, time.monotonic(), 0.0
        hung = False
        while child.poll() is None and not hung:
            time.sleep(0.1)
            now = told.stat().st_size if told.exists() else 0
            if now != size:
                size, since, worked_s = now, time.monotonic(), processor_s(child.pid)
            longest_s = LONGEST_S if size else STARTING_S
            hung = processor_s(child.pid) - worked_s > longest_s or time.monotonic() - since > BUSY * longest_s
        if hung:
            os.killpg(child.pid, signal.SIGKILL)
        child.wait()
        for row in rows_of(told):
            if "begin" in row:
                cases[row["begin"]] = Case(row["begin"], row["kind"], row["command"], row["spoilt"])
            else:
                case = cases[row["end"]]
                case.code, case.seconds, case.stderr = row["code"], row["seconds"], row["stderr"]
        began = max(cases, default=-1)
        assert began >= first, (folder / "child.stderr").read_text()[-2000:]
        if cases[began].code is None:
            cases[began].stderr = "hangs" if hung else f"died with {child.returncode}"
        first = began + 1
    return [cases[number] for number in sorted(cases)]


@pytest.mark.slow
def test_no_spoilt_input_ends_in_a_traceback_a_hang_or_an_unknown_exit_code(tmp_path):
    cases = run_cases(tmp_path)
    assert len(cases) == CASES
    report = os.environ.get("HARNESS_FUZZ_REPORT")
    if report:
        with Path(report).open("a", encoding="utf-8") as file:
            file.writelines(json.dumps(vars(case) | {"fault": case.fault()}) + "\n" for case in cases)
    faulty = [case for case in cases if case.fault()]
    faults = [f"{case.number} {case.kind}: {case.fault()}: {case.command}\n{case.stderr[-1500:]}" for case in faulty]
    assert not faults, "\n\n".join(faults)
    codes = Counter(case.code for case in cases)
    assert codes[exitcodes.WRONG_INPUT] > CASES / 4, "hardly anything was refused: the inputs are no test"
