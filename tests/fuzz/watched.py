"""Cases that are tried in child processes: one that hangs or dies costs its case, and another goes on behind it."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from harness.common import exit_codes

ROOT = Path(__file__).parents[2]
LONGEST_S, MOST_BYTES = 60.0, 2 << 30
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
    written: tuple[str, ...] = ()
    peak_bytes: int = 0

    def fault(self) -> str:
        """Return what is wrong with how it ended; empty if nothing is."""
        if self.code is None:
            return self.stderr or "the process died"
        if self.peak_bytes > MOST_BYTES or self.written:
            return f"took {self.peak_bytes / 1e9:.1f} GB, wrote or removed {', '.join(self.written) or 'nothing'}"
        if "Traceback" in self.stderr:
            return "traceback"
        if self.code not in exit_codes.MEANINGS or self.code == exit_codes.INTERNAL:
            return f"exit code {self.code}"
        lines = [line for line in self.stderr.splitlines() if line.startswith("error:")]
        if self.code == exit_codes.WRONG_INPUT and len(lines) != 1:
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


def run_cases(folder: Path, child: Sequence[str], first: int, end: int) -> list[Case]:
    """Run the cases from a number up to another in child processes, and return them in order.

    Args:
        folder: An empty folder.
        child: The module that runs cases and its arguments; it is also told the first case, the end, and a file, to
            which it adds a line of JSON before and after each.
        first: Number of the first case.
        end: The number after the last.
    """
    cases: dict[int, Case] = {}
    child_number = 0
    while first < end:
        told = folder / f"told-{child_number}.jsonl"
        child_number += 1
        with (folder / "child.stderr").open("wb") as complaints:
            process = subprocess.Popen(
                [sys.executable, "-m", *child, str(first), str(end), str(told)],
                cwd=ROOT,
                stderr=complaints,
                env={**os.environ, "OMP_NUM_THREADS": "1"},
                start_new_session=True,
            )
        hung = _hangs(process, told)
        if hung:
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        for row in rows_of(told):
            if "begin" in row:
                cases[row["begin"]] = Case(row["begin"], row["kind"], row["command"], row["spoilt"])
            else:
                case = cases[row["end"]]
                case.code, case.seconds, case.stderr = row["code"], row["seconds"], row["stderr"]
                case.peak_bytes = row.get("peak_bytes", 0)
                case.written = tuple(row.get("written", ()))
        began = max(cases, default=-1)
        assert began >= first, (folder / "child.stderr").read_text()[-2000:]
        if cases[began].code is None:
            cases[began].stderr = "hangs" if hung else f"died with {process.returncode}"
        first = began + 1
    return [cases[number] for number in sorted(cases)]


def _hangs(process: subprocess.Popen[bytes], told: Path) -> bool:
    """Wait until a child ends, or a case of it takes too long."""
    size, since, worked_s = -1, time.monotonic(), 0.0
    while process.poll() is None:
        time.sleep(0.1)
        now = told.stat().st_size if told.exists() else 0
        if now != size:
            size, since, worked_s = now, time.monotonic(), processor_s(process.pid)
        longest_s = LONGEST_S if size else STARTING_S
        if processor_s(process.pid) - worked_s > longest_s or time.monotonic() - since > BUSY * longest_s:
            return True
    return False
