"""Lets ``run`` and ``stress`` write to disks of random sizes that are too small, and looks at what is left.

The disks are real ones in memory (tmpfs), mounted in a name space of their own, so no rights are needed where the
system lets users make such name spaces.
"""

from __future__ import annotations

import math
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import pandas as pd

from tests.harness.truth.recorded import layouts
from tests.kill.killing import REPOSITORY, STRESS, TABLES, WORKERS, differences, row_of

ALONE = ("unshare", "--user", "--map-root-user", "--mount")
PAGE_BYTES = 4096
LARGE = "1g"
LONGEST_S = 600.0
DONE, WRONG_INPUT, FAILED = 0, 2, 3


@dataclass
class Filled:
    """One disk that was too small.

    Attributes:
        command: ``run`` or ``stress``.
        size_kb: How large the disk was.
        needed_kb: How large the finished folder is.
        outcome: What was left, in words.
        faults: What should not be so.
    """

    command: str
    size_kb: int
    needed_kb: int
    outcome: str = ""
    faults: list[str] = field(default_factory=list)

    def as_line(self) -> str:
        """Return it on one line."""
        faults = "; ".join(self.faults) or "nothing lost"
        return f"{self.command:6} {self.size_kb:5d} of {self.needed_kb} kB: {self.outcome}: {faults}"


def can_mount() -> bool:
    """Return whether this system lets us mount disks of our own."""
    probe = [*ALONE, "mount", "-t", "tmpfs", "none", "/mnt"]
    return (
        shutil.which(ALONE[0]) is not None and subprocess.run(probe, capture_output=True, check=False).returncode == 0
    )


def fill_often(moments: int, seed: int, folder: Path, tell: Callable[[Filled], object] = str) -> list[Filled]:
    """Fill disks under runs and grids in turns and return what came of it; to be called within ``ALONE``.

    Args:
        moments: How often.
        seed: Root of the sizes.
        folder: An empty folder.
        tell: Called after each.
    """
    draw = random.Random(seed)
    targets = (_FilledRun(folder), _FilledGrid(folder))
    done: list[Filled] = []
    while len(done) < moments:
        target = targets[len(done) % len(targets)]
        # Small disks as often as large ones: tables are small beside pages and pictures.
        pages = round(math.exp(draw.uniform(math.log(2), math.log(1.05 * target.pages))))
        found = target.fill(pages)
        if found is not None:
            done.append(found)
            tell(found)
    return done


class _Filled:
    """A command on a disk that is too small, beside a copy of it on one that is not."""

    def __init__(self, folder: Path, command: tuple[str, ...], module: str = "harness") -> None:
        self.command, self.module = command, module
        self.whole, self.disk = folder / f"whole-{command[0]}", folder / f"disk-{command[0]}"
        self.disk.mkdir()
        subprocess.run(self._words(self.whole), cwd=REPOSITORY, check=True)
        sizes = [path.stat().st_size for path in self.whole.rglob("*") if path.is_file()]
        self.pages = sum(-(-size // PAGE_BYTES) for size in sizes)

    def fill(self, pages: int) -> Filled | None:
        """Run the command on a disk of so many pages; None if they were enough."""
        found = Filled(self.command[0], pages * PAGE_BYTES // 1024, self.pages * PAGE_BYTES // 1024)
        self._mount(f"size={pages * PAGE_BYTES}")
        try:
            words = self._words(self.disk / "out")
            ended = subprocess.run(
                words, cwd=REPOSITORY, capture_output=True, text=True, timeout=LONGEST_S, check=False
            )
            if ended.returncode == DONE:
                return None
            if ended.returncode not in (WRONG_INPUT, FAILED):
                found.faults.append(f"exit code {ended.returncode}")
            if len(ended.stderr.splitlines()) != 1 or "No space left on device" not in ended.stderr:
                found.faults.append(f"said {ended.stderr!r}")
            found.outcome = self.look(found)
            self._mount(f"remount,size={LARGE}")
            subprocess.run(words, cwd=REPOSITORY, check=True)
            found.faults += self.differences()
        finally:
            subprocess.run(["umount", str(self.disk)], check=True)
        return found

    def look(self, found: Filled) -> str:
        """Say what was left and enter what is wrong with it."""
        raise NotImplementedError

    def differences(self) -> list[str]:
        """Return what differs, after the command was let run to its end, from the copy."""
        raise NotImplementedError

    def _words(self, out: Path) -> list[str]:
        return [sys.executable, "-m", self.module, *self.command, "--out", str(out)]

    def _mount(self, options: str) -> None:
        subprocess.run(["mount", "-t", "tmpfs", "-o", options, "none", str(self.disk)], check=True)


class _FilledRun(_Filled):
    def __init__(self, folder: Path) -> None:
        recording = layouts.write_fcd(folder / "recording")
        options = ("--replay", str(recording), "--ego", "each", "--tracker", "tests.harness.stand_ins:echo_tracker")
        super().__init__(folder, ("run", *options, "--quiet"), "tests.kill.in_stretches")

    def look(self, found: Filled) -> str:
        left = {path.name for path in self.disk.iterdir()}
        found.faults += [f"{name} was left" for name in left - {"out.incomplete"}]
        if not left:
            return "nothing was done"
        kept = {name: _rows(self.disk / "out.incomplete", name) for name in TABLES}
        steps = kept["truth"]["step"].nunique()
        for name, rows in kept.items():
            whole = _rows(self.whole, name)
            wanted = whole[whole["step"].isin(kept["truth"]["step"])].reset_index(drop=True)
            found.faults += [] if rows.equals(wanted) else [f"{name} of {steps} steps differ"]
        parts = len(list((self.disk / "out.incomplete").glob("*-[0-9].parquet")))
        return f"{steps} steps were kept" + (f", {parts} parts apart" if parts else "")

    def differences(self) -> list[str]:
        faults = [
            f"{path.name} of the run made again differs"
            for path in self.whole.glob("*.parquet")
            if (self.disk / "out" / path.name).read_bytes() != path.read_bytes()
        ]
        return faults + [f"{path.name} was left" for path in self.disk.glob(".*")]


class _FilledGrid(_Filled):
    def __init__(self, folder: Path) -> None:
        super().__init__(folder, (*STRESS, *WORKERS))
        self.rows = {path.name: row_of(path) for path in (self.whole / "runs").glob("*.json")}

    def look(self, found: Filled) -> str:
        rows = {path.name: row_of(path) for path in (self.disk / "out" / "runs").glob("*.json")}
        found.faults += [f"row {name} differs" for name, row in rows.items() if row != self.rows[name]]
        return f"{len(rows)} of {len(self.rows)} runs were kept"

    def differences(self) -> list[str]:
        return differences(self.disk / "out", self.whole)


def _rows(folder: Path, table: str) -> pd.DataFrame:
    """Return the rows of a table, those that lie beside it too."""
    parts = [folder / f"{table}.parquet", *sorted(folder.glob(f"{table}-[0-9].parquet"))]
    return pd.concat([pd.read_parquet(part) for part in parts], ignore_index=True)


def in_own_name_space(words: list[str]) -> int:
    """Run this program again where it may mount, and return its exit code."""
    return subprocess.run([*ALONE, sys.executable, "-m", *words], cwd=os.getcwd(), check=False).returncode
