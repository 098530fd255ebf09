"""Starts ``run``, ``stress``, ``drive`` and ``score``, ends them at a random moment, and looks at what is left."""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
import uuid
from collections.abc import Callable, Iterable
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from tests.harness.grid.executors import is_timing, table_of
from tests.harness.grid.test_cluster import dask_cluster

REPOSITORY = Path(__file__).parents[2]
RUN = ("run", "--density", "10", "--duration", "2", "--particles", "20", "--seed", "3", "--quiet")
STRESS = (
    *("stress", "--densities", "10,15", "--seeds", "1", "--models", "cvm,cam", "--particles", "20"),
    *("--duration", "1", "--quiet", "--resume"),
)
DRIVE = (
    *("drive", "--density", "15", "--perception", "truth,detections", "--episodes", "4", "--seed", "100"),
    *("--quiet", "--resume"),
)
WORKERS = ("--workers", "2")
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
EXIT_CODES = {signal.SIGKILL: -9, signal.SIGTERM: 143, signal.SIGINT: 130}
TABLES = ("truth", "detections", "tracks")
FIRST_MOMENT_S = 0.5
"""Before it the interpreter itself may not have started, which ends without a word."""
ORPHANS_S = 60.0
LONGEST_S = 600.0
"""After it a command that was told to end counts as hanging; generous, for busy machines."""
STORY = 3
"""After so many kills, or once all its runs are done, a grid is let run to its end and begun anew."""


@dataclass
class Kill:
    """One kill.

    Attributes:
        command: ``run``, ``score``, ``stress`` and ``drive`` (on two workers of this machine), or ``dask`` (``stress``
            on two of a cluster).
        signal: What ended it.
        after_s: When, after its start.
        outcome: What was there at that moment, in words.
        faults: What should not be so.
    """

    command: str
    signal: signal.Signals
    after_s: float
    outcome: str = ""
    faults: list[str] = field(default_factory=list)

    def as_line(self) -> str:
        """Return it on one line."""
        faults = "; ".join(self.faults) or "nothing lost"
        return f"{self.command:9} {self.signal.name:7} after {self.after_s:5.2f} s: {self.outcome}: {faults}"


def kill_often(
    kills: int, seed: int, folder: Path, tell: Callable[[Kill], object] = str, dask: bool = False
) -> list[Kill]:
    """Kill runs and grids in turns and return what came of it.

    Args:
        kills: How often.
        seed: Root of the moments and signals.
        folder: An empty folder.
        tell: Called after each kill.
        dask: Whether one of five is a grid on a cluster.
    """
    draw = random.Random(seed)
    with dask_cluster(folder) if dask else nullcontext((None, ())) as (scheduler, _):
        makers: list[Callable[[], _Killed]] = [
            lambda: _KilledRun(folder, "run", RUN),
            lambda: _KilledGrid(folder, "stress", (*STRESS, *WORKERS)),
            lambda: _KilledGrid(folder, "drive", (*DRIVE, *WORKERS)),
            lambda: _KilledRun(folder, "score", score_of(folder / "whole-run")),
        ]
        if scheduler is not None:
            makers.insert(2, lambda: _KilledGrid(folder, "dask", (*STRESS, "--scheduler", scheduler)))
        targets = [make() for make in makers[:kills]]
        done: list[Kill] = []
        for number in range(kills):
            target = targets[number % len(targets)]
            moment = draw.uniform(FIRST_MOMENT_S, target.lasts_s)
            done.append(target.kill(Kill(target.name, draw.choice(SIGNALS), moment)))
            tell(done[-1])
        for target in targets:
            if done and isinstance(target, _KilledGrid) and target.kills:
                done[-1].faults += target.finish()
    return done


class _Killed:
    """A command that is killed, beside a copy of it that never was."""

    def __init__(self, folder: Path, name: str, command: tuple[str, ...]) -> None:
        self.name, self.command = name, command
        self.whole, self.out = folder / f"whole-{name}", folder / f"killed-{name}"
        self.whole.parent.mkdir(exist_ok=True)
        self.lasts_s = LONGEST_S
        self._make(self.whole)

    def kill(self, kill: Kill) -> Kill:
        """Start the command, end it, and look."""
        mark = uuid.uuid4().hex
        process = subprocess.Popen(
            self._words(self.out),
            cwd=REPOSITORY,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "KILL_MARK": mark},
            # Shells start background jobs with Ctrl-C ignored, which a child inherits.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
        )
        time.sleep(kill.after_s)
        before = self.finished()
        process.send_signal(kill.signal)
        _, err = process.communicate(timeout=LONGEST_S)
        code = process.returncode
        if code not in (0, EXIT_CODES[kill.signal]):
            kill.faults.append(f"exit code {code}")
        if len(err.splitlines()) > 1 or "Traceback" in err:
            kill.faults.append(f"said {err!r}")
        after = self.finished()
        kill.faults += [f"{name} was lost" for name in before if before[name] != after.get(name)]
        kill.faults += orphans(mark)
        kill.outcome = self.look(kill)
        return kill

    def finished(self) -> dict[str, bytes]:
        """Return everything finished that the folder holds now."""
        raise NotImplementedError

    def look(self, kill: Kill) -> str:
        """Say what was left and enter what is wrong with it."""
        raise NotImplementedError

    def _make(self, out: Path) -> None:
        begin = time.monotonic()
        subprocess.run(self._words(out), cwd=REPOSITORY, check=True)
        self.lasts_s = min(self.lasts_s, time.monotonic() - begin)

    def _words(self, out: Path) -> list[str]:
        return [sys.executable, "-m", "harness", *self.command, "--out", str(out)]


class _KilledRun(_Killed):
    def finished(self) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in self.out.glob("*.parquet")}

    def look(self, kill: Kill) -> str:
        left = self.out.with_name(f"{self.out.name}.incomplete")
        outcome = "no step was done"
        if self.out.exists():
            outcome = "all was done"
            lacking = {path.name for path in self.whole.iterdir()} - {path.name for path in self.out.iterdir()}
            kill.faults += [f"{name} is not there" for name in lacking]
        elif left.exists():
            steps = json.loads((left / "manifest.json").read_text())["steps"]
            outcome = "some steps were done"
            for name in TABLES:
                whole = pd.read_parquet(self.whole / f"{name}.parquet")
                kept = pd.read_parquet(left / f"{name}.parquet")
                first = whole[whole["step"] < steps].reset_index(drop=True)
                kill.faults += [] if kept.equals(first) else [f"{name} of {steps} steps differ"]
        elif kill.signal == signal.SIGKILL:
            outcome = "killed, nothing half-written is visible"
        shutil.rmtree(left, ignore_errors=True)
        shutil.rmtree(self.out, ignore_errors=True)
        self._make(self.out)
        for path in self.whole.glob("*.parquet"):
            if (self.out / path.name).read_bytes() != path.read_bytes():
                kill.faults.append(f"{path.name} of the run made again differs")
        hidden = [path.name for path in self.out.parent.glob(".*")]
        kill.faults += [f"{name} was left" for name in hidden]
        shutil.rmtree(self.out)
        return outcome


class _KilledGrid(_Killed):
    def __init__(self, folder: Path, name: str, command: tuple[str, ...]) -> None:
        super().__init__(folder, name, command)
        self.rows = {path.name: row_of(path) for path in (self.whole / "runs").glob("*.json")}
        self.kills = 0

    def finished(self) -> dict[str, bytes]:
        return {path.name: path.read_bytes() for path in (self.out / "runs").glob("*.json")}

    def look(self, kill: Kill) -> str:
        self.kills += 1
        rows = {path.name: row_of(path) for path in (self.out / "runs").glob("*.json")}
        kill.faults += [f"row {name} differs" for name, row in rows.items() if row != self.rows.get(name)]
        # Of a grid that is done already a kill shows little.
        if self.kills >= STORY or len(rows) == len(self.rows):
            kill.faults += self.finish()
        some = "no" if not rows else "some" if len(rows) < len(self.rows) else "all"
        return f"{some} runs were done"

    def finish(self) -> list[str]:
        """Let the grid run to its end, and return what differs from one that was never killed."""
        self.kills = 0
        self._make(self.out)
        faults = differences(self.out, self.whole)
        shutil.rmtree(self.out)
        return faults


def score_of(run: Path) -> tuple[str, ...]:
    """Return the command that scores a run's own tracks against its truth."""
    return ("score", "--truth", str(run), "--tracks", str(run / "tracks.parquet"), "--quiet")


def differences(folder: Path, whole: Path) -> list[str]:
    """Return in what a finished grid differs from one that was never ended, wall times aside."""
    faults = [] if table_of(folder).equals(table_of(whole)) else ["runs.parquet differs"]
    named = {path.relative_to(folder) for path in folder.rglob("*")}
    wanted = {path.relative_to(whole) for path in whole.rglob("*")}
    return faults + [f"{path} is left or missing" for path in named ^ wanted]


def row_of(path: Path) -> dict[str, Any]:
    """Return a row without what differs between two runs of the same thing: wall times."""
    return {name: value for name, value in json.loads(path.read_text()).items() if not is_timing(name)}


def orphans(mark: str) -> Iterable[str]:
    """Yield the processes of a killed command that live on for too long."""
    end = time.monotonic() + ORPHANS_S
    while (left := list(_processes_with(mark.encode()))) and time.monotonic() < end:
        time.sleep(0.1)
    return [f"process {process} lives on" for process in left]


def _processes_with(mark: bytes) -> Iterable[str]:
    for path in Path("/proc").glob("[0-9]*/environ"):
        try:
            if mark in path.read_bytes():
                yield path.parent.name
        except OSError:
            continue
