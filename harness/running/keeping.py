"""What a run keeps as it goes on: stretch by stretch its tables are scored, written into its folder and let go of."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from harness.running.metrics import TrafficSums
from harness.running.recorder import STRETCH_ROWS, ColumnRecorder, RunTables
from harness.running.unseen import UnseenKeeper
from harness.running.watchers import DiagnosticsKeeper, ParticleKeeper
from harness.scoring import RunScorer, ScoredRun, ScoredStretch
from harness.scoring.metrics.scarce import check_scored
from harness.storage import run_folder as runfolder
from harness.storage.growing import GrowingTables, sampled_rows

if TYPE_CHECKING:
    import pandas as pd

    from harness.scoring.driving.asked import Driven

Timed = Callable[[str], AbstractContextManager[None]]
MOST_DRAWN = 300_000


class RunKeeper:
    """Keeps a run in a folder, never more than one stretch of it in memory.

    A run of a single stretch, as short ones are, is scored as a whole when it has ended. So is one whose metrics are
    not all in parts, however long it is.

    Attributes:
        recorder: Takes in every finished step.
        diagnostics: Watches what the tracker tells of itself.
        particles: Watches its particles.
        unseen: Watches what is expected where it has no track.
    """

    def __init__(self, folder: Path, driven: Driven, unseen: UnseenKeeper, seed: int, timed: Timed) -> None:
        """Begin.

        Args:
            folder: Where the tables go.
            driven: The road, and the driver that is asked on it.
            unseen: Keeps what is expected where the tracker has no track.
            seed: Seed of the run.
            timed: Times a phase of the run, ``score`` or ``write``.
        """
        self.diagnostics, self.particles, self.unseen = DiagnosticsKeeper(), ParticleKeeper(), unseen
        self._folder, self._road, self._timed = folder, driven.road, timed
        self._scorer = RunScorer(seed, driven)
        self._tables = GrowingTables(folder)
        self._traffic = TrafficSums()
        self._stretch = 0
        end_stretch = self._end_stretch if self._scorer.takes_stretches else None
        self.recorder = ColumnRecorder(end_stretch=end_stretch, stretch_rows=STRETCH_ROWS)

    def finish(self) -> dict[str, Any]:
        """Score and write the last stretch, finish the tables and return the run's scores.

        Raises:
            InputError: There is nothing to score.
        """
        self._end_stretch()
        with self._timed("score"):
            metrics = self._scorer.metrics()
            check_scored(metrics, self.recorder.steps)
        # Half put together, a table would get its later stretches twice from ``leave``.
        with self._timed("write"), signals_held():
            self._tables.close()
        return metrics

    def leave(self) -> tuple[int, list[str]]:
        """Write what is kept of a run that did not end, no scores.

        Returns:
            How many steps its tables have, and the files with later rows that there was no room to enter in a table.

        Raises:
            OSError: There is no room for the first stretch.
        """
        self._tables.drop((runfolder.ERRORS, runfolder.EVENTS, runfolder.BRAKINGS, runfolder.COMMANDS))
        steps = self.recorder.steps
        if self.recorder.kept:
            try:
                self._tables.append(self._stretch, self._with_watched(self.recorder.tables()))
            except (OSError, MemoryError):
                if not self._stretch:
                    raise
                self._tables.take_back(self._stretch)
                steps -= self.recorder.kept
        return steps, self._tables.close_or_leave_apart()

    def traffic(self) -> dict[str, Any]:
        """Return the ``traffic`` table of the finished run."""
        return self._traffic.table(self._road)

    def drawn_errors(self) -> pd.DataFrame:
        """Return the rows of the finished error table that figures show: all, or those of some steps of a long run."""
        return sampled_rows(self._folder / runfolder.ERRORS, MOST_DRAWN)

    def drawn_diagnostics(self) -> pd.DataFrame | None:
        """Return the rows of the tracker's diagnostics that figures show; None of one that tells nothing."""
        path = self._folder / runfolder.DIAGNOSTICS
        return sampled_rows(path, MOST_DRAWN) if path.is_file() else None

    def _end_stretch(self) -> None:
        tables = self.recorder.tables()
        with self._timed("score"):
            scored = self._scorer.add(tables.truth, tables.detections, tables.tracks, self.unseen.table())
        with self._timed("write"), signals_held():
            self._traffic.add(tables.truth, self._road)
            self._tables.append(self._stretch, self._with_watched(tables) | tables_of(scored))
            self._stretch += 1
            for keeper in (self.recorder, self.diagnostics, self.particles, self.unseen):
                keeper.forget()

    def _with_watched(self, tables: RunTables) -> dict[str, pd.DataFrame]:
        """Return the tables of a stretch by file, with those of the watchers that have any."""
        watched = {
            runfolder.DIAGNOSTICS: self.diagnostics.table(),
            runfolder.PARTICLES: self.particles.table(),
            runfolder.UNSEEN: self.unseen.table(),
        }
        return {
            **{name: table for name, table in watched.items() if table is not None},
            runfolder.TRUTH: tables.truth,
            runfolder.DETECTIONS: tables.detections,
            runfolder.TRACKS: tables.tracks,
        }


def tables_of(scored: ScoredStretch | ScoredRun) -> dict[str, pd.DataFrame]:
    """Return the tables that scoring made by the file that each goes to."""
    tables = {
        runfolder.ERRORS: scored.errors,
        runfolder.EVENTS: scored.events,
        runfolder.BRAKINGS: scored.brakings,
        runfolder.COMMANDS: scored.commands,
    }
    return {name: table for name, table in tables.items() if table is not None}


@contextmanager
def signals_held() -> Iterator[None]:
    """Let Ctrl-C and the other signals that end a program wait until what must not be half done is done."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []

    def hold(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
        came.append(number)

    ends = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    previous = [signal.signal(end, hold) for end in ends]
    try:
        yield
    finally:
        for end, handler in zip(ends, previous, strict=True):
            signal.signal(end, handler)
        if came:
            signal.raise_signal(came[0])
