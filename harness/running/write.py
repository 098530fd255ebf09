"""Writes a run's folder, at once or while the run goes on."""

import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import pandas as pd
import pyarrow as pa

from harness.common.files import write_text
from harness.common.numbers import as_json
from harness.storage import run_folder as runfolder
from harness.storage.checks import rows_of
from harness.storage.manifest import RunFacts, hashes_of, write_manifest
from harness.storage.tables import GrowingTables


@dataclass
class RunWriter:
    """Writes a run's tables stretch by stretch, and at its end what is to be said of it.

    Attributes:
        command: What made it.
        inputs: SHA-256 of each input file.
        code: SHA-256 of the code that decides results.
        is_log: Whether the tracks are a log's.
        wall_s: Wall time of each phase so far.
    """

    folder: Path
    seed: int
    command: str
    inputs: Mapping[str, str] = field(default_factory=dict)
    code: Mapping[str, str] = field(default_factory=dict)
    is_log: bool = False
    wall_s: dict[str, float] = field(default_factory=dict)
    _stretch: int = 0

    def __post_init__(self) -> None:
        """Begin without a table."""
        self._tables = GrowingTables(self.folder)
        self.keep_room = self._tables.keep_room

    @contextmanager
    def timed(self, phase: str) -> Iterator[None]:
        """Add the wall time of a block to that of a phase."""
        begin = perf_counter()
        try:
            yield
        finally:
            self.wall_s[phase] = self.wall_s.get(phase, 0.0) + perf_counter() - begin

    def append(self, tables: Mapping[str, pd.DataFrame]) -> None:
        """Write the next stretch of the tables, by file."""
        self._tables.append(self._stretch, tables)
        self._stretch += 1

    def close(self) -> None:
        """Put the stretches of each table together."""
        self._tables.close()

    def finish(self, metrics: Mapping[str, Any], steps: int) -> None:
        """Write the metrics of a run whose tables are closed; the manifest last, so that half a folder is none."""
        write_text(self.folder / runfolder.METRICS, as_json(dict(metrics)))
        self._write_manifest(runfolder.COMPLETE, None, steps, rows_of(self.folder))

    def leave(self, status: str, problem: str, steps: int, rest: Mapping[str, pd.DataFrame]) -> str:
        """Write the unfinished run without scores, and return a sentence on what is missing for lack of space.

        Args:
            status: What became of it, for the manifest.

        Raises:
            OSError: There is no room for the first stretch.
        """
        # What only a finished run has goes first: it would tell of an end that was none, and takes room.
        for name in (runfolder.MANIFEST, runfolder.METRICS):
            (self.folder / name).unlink(missing_ok=True)
        shutil.rmtree(self.folder / runfolder.FIGURES, ignore_errors=True)
        beside = (runfolder.DIAGNOSTICS, runfolder.PARTICLES, runfolder.UNSEEN) if not self._stretch else ()
        self._tables.drop((runfolder.ERRORS, runfolder.EVENTS, runfolder.BRAKINGS, runfolder.COMMANDS, *beside))
        unwritten = rest[runfolder.TRUTH]["step"].nunique() if len(rest.get(runfolder.TRUTH, ())) else 0
        needed = {name: rest[name] for name in (runfolder.TRUTH, runfolder.DETECTIONS, runfolder.TRACKS) if unwritten}
        try:
            self._tables.append(self._stretch, needed)
        except (OSError, MemoryError):
            if not self._stretch:
                raise
            self._tables.take_back(self._stretch)
            steps, unwritten = steps - unwritten, 0
        flaws = ""
        try:
            self._tables.close()
        except (OSError, MemoryError, pa.ArrowException):
            flaws += ", later rows of its tables in files of their own"
        try:
            self._write_manifest(status, problem, steps, {})
        except OSError:
            flaws += f", {runfolder.MANIFEST} found no room"
        # What can be done without comes last.
        with suppress(OSError, MemoryError, pa.ArrowException):
            self._tables.append(self._stretch, rest if unwritten else {})
            self._tables.close()
        return flaws

    def _write_manifest(self, status: str, problem: str | None, steps: int, rows: Mapping[str, int]) -> None:
        files = hashes_of(self.folder) if status == runfolder.COMPLETE else {}
        facts = (status, self.command, self.seed, steps, self.inputs, self.wall_s, problem, rows, self.code, files)
        write_manifest(self.folder / runfolder.MANIFEST, RunFacts(*facts, is_log=self.is_log))
