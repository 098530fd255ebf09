"""One run from configuration to finished folder."""

from __future__ import annotations

import shutil
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

from harness.common.errors import InputError, RunError, RunInterruptedError
from harness.common.files import write_text
from harness.common.numbers import as_json
from harness.common.progress import progress_bar, working
from harness.common.signals import told_to_end
from harness.config.model import RunConfig
from harness.running.follow import StageTimes, follow
from harness.running.keeping import RunKeeper
from harness.running.looks import Looks, Streams
from harness.running.metrics import assemble_metrics, timing_table
from harness.running.open import (
    OpenLooks,
    as_believed,
    check_driver,
    check_tracker,
    driven_on,
    open_looks,
    tracker_builder,
)
from harness.running.resolve import write_config
from harness.running.unseen import UnseenKeeper
from harness.running.watchers import Moment, MomentKeeper
from harness.storage import run_folder as runfolder
from harness.storage.checks import rows_of
from harness.storage.manifest import RunFacts, write_manifest
from mmpf.map.road import Road
from mmpf.scan import SensorModel

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class FinishedRun:
    """A run that ended.

    Attributes:
        folder: Where its files lie.
        metrics: Content of its ``metrics.json``.
    """

    folder: Path
    metrics: dict[str, Any]


@dataclass(frozen=True)
class Pictured:
    """What a run's figures show.

    Attributes:
        title: What was run, in a few words.
        road: The lanes.
        sensor: The sensor's data sheet.
        errors: Rows of the error table, of a long run those of some steps.
        metrics: The run's scores.
        moment: The moment that is seen from above.
        diagnostics: What the tracker told of each step; None of one that tells nothing.
    """

    title: str
    road: Road
    sensor: SensorModel
    errors: pd.DataFrame
    metrics: Mapping[str, Any]
    moment: Moment | None
    diagnostics: pd.DataFrame | None


@dataclass(frozen=True)
class Drawing:
    """Draws a run into its folder while that is not finished; handed in, since a run itself never draws.

    Attributes:
        figures: Draws figures into a folder of their own.
        page: Writes the page of a run's folder in which everything else lies.
    """

    figures: Callable[[Path, Pictured], object]
    page: Callable[[Path], object]


def run(
    config: RunConfig,
    *,
    out: Path | None = None,
    force: bool = False,
    command: str = "",
    quiet: bool = True,
    draw: Drawing | None = None,
    open_looks: OpenLooks = open_looks,
) -> FinishedRun:
    """Simulate or replay, track, score, draw, and leave a run folder.

    Args:
        config: What to run.
        out: Where the folder goes; by default a name in ``results/`` that tells the main settings.
        force: Whether an earlier run in ``out`` may be replaced.
        command: What the user typed, for the manifest.
        quiet: Whether to leave out the progress bar.
        draw: Draws the run; nothing is drawn if None.
        open_looks: Opens what the configuration asks to look at.

    Raises:
        InputError: The input is wrong or no window can be opened; nothing is left behind.
        RunError: The run failed part-way; its finished steps lie in a folder that says so.
        RunInterruptedError: The user stopped the run; likewise.
    """
    check_tracker(config)
    check_driver(config)
    pending = runfolder.open_folder(out, config.default_folder_name(), force)
    attempt = _Attempt(config, pending.path, command)
    if pending.replaced is not None and not quiet:
        sys.stderr.write(f"when this run is done it replaces {pending.replaced}\n")
    try:
        metrics = attempt.complete(open_looks, draw, quiet)
        with _uninterrupted():
            return FinishedRun(folder=pending.finish(), metrics=metrics)
    except InputError:
        pending.discard()
        raise
    except (KeyboardInterrupt, Exception) as error:
        if is_interrupt(error):
            raise _interrupted(attempt, pending) from None
        if isinstance(error, RunError | OSError | MemoryError) and not attempt.steps:
            pending.discard()
            if isinstance(error, RunError):
                raise
            raise RunError(f"the run failed before its first step: {_in_words(error)}") from error
        left = _leave(attempt, pending, runfolder.FAILED, traceback.format_exc())
        if runfolder.MANIFEST not in left:
            left = left.replace("steps are", f"steps and the traceback ({runfolder.MANIFEST}) are")
        raise RunError(f"the run failed after {attempt.steps} steps: {_in_words(error)}; {left}") from error
    finally:
        attempt.close()


def is_interrupt(error: BaseException) -> bool:
    """Return whether Ctrl-C is behind an error: compiled code that it stops may raise a SystemError from it."""
    if told_to_end():
        return True
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            return True
        cause = cause.__cause__ or cause.__context__
    return False


def _interrupted(attempt: _Attempt, pending: runfolder.PendingFolder) -> RunInterruptedError:
    """Keep what was finished and return the error that says where."""
    if not attempt.steps:
        pending.discard()
        return RunInterruptedError("interrupted before the first step; nothing is kept")
    left = _leave(attempt, pending, runfolder.INTERRUPTED, "interrupted by the user")
    return RunInterruptedError(f"interrupted after {attempt.steps} steps; {left}")


def _leave(attempt: _Attempt, pending: runfolder.PendingFolder, status: str, problem: str) -> str:
    """Keep the finished steps if the disk takes them, and return in words what became of them."""
    with _uninterrupted():
        try:
            flaws = attempt.leave(status, problem)
            return f"the finished steps are in {pending.leave_incomplete()}{flaws}"
        except (OSError, MemoryError) as error:
            # A folder that lacks some of its tables is of no use, and takes room that there is none of.
            pending.discard()
            return f"the finished steps could not be kept ({_in_words(error)})"


def _in_words(error: BaseException) -> str:
    if isinstance(error, RunError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename}: {error.strerror}" if error.filename and error.strerror else str(error)
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__


@dataclass
class _Attempt:
    """A run on its way: what is known so far, and how to write it."""

    config: RunConfig
    folder: Path
    command: str
    keeper: RunKeeper | None = None
    moment: MomentKeeper = field(default_factory=MomentKeeper)
    times: StageTimes = field(default_factory=StageTimes)
    wall_s: dict[str, float] = field(default_factory=dict)
    looks: Looks | None = None

    @property
    def steps(self) -> int:
        """How many steps are finished."""
        return self.keeper.recorder.steps if self.keeper is not None else 0

    def complete(self, open_looks: OpenLooks, draw: Drawing | None, quiet: bool) -> dict[str, Any]:
        """Do the whole run and return the metrics."""
        begin = perf_counter()
        write_config(self.config, self.folder / runfolder.CONFIG)
        with self._timed("open"), working(_opening(self.config), quiet):
            looks = self.looks = open_looks(self.config)

        def say(line: str) -> None:
            if line and not quiet:
                sys.stderr.write(line + "\n")

        say(looks.report)
        runfolder.write_road(looks.road, self.folder / runfolder.ROAD)
        told = as_believed(looks, self.config)
        keeper = self.keeper = RunKeeper(
            self.folder,
            driven_on(looks.road, self.config),
            UnseenKeeper(told.road, told.sensor),
            self.config.seed,
            self._timed,
        )
        with self._timed("loop"):
            self._loop(told, keeper, quiet)
        # What was scored and written between two steps is in their own phases.
        self.wall_s["loop"] -= self.wall_s.get("score", 0.0) + self.wall_s.get("write", 0.0)
        with working("scoring", quiet):
            scores = keeper.finish()
        if draw is not None:
            with self._timed("draw"), working("drawing", quiet):
                draw.figures(self.folder / runfolder.FIGURES, self._pictured(looks, keeper, scores))
        metrics = assemble_metrics(
            self.config,
            scores | dict(looks.about),
            timing_table(self.times, looks.step_s, perf_counter() - begin, keeper.diagnostics.stages_ms),
            keeper.traffic(),
        )
        write_text(self.folder / runfolder.METRICS, as_json(metrics))
        self.write_manifest(runfolder.COMPLETE, None, self.steps)
        if draw is not None:
            with working("writing the page", quiet):
                draw.page(self.folder)
        return metrics

    def leave(self, status: str, problem: str) -> str:
        """Write what there is of a run that did not end, and return in words what it lacks for want of room."""
        # What only a finished run has goes first: it would tell of an end that was none, and takes room.
        for name in (runfolder.MANIFEST, runfolder.METRICS):
            (self.folder / name).unlink(missing_ok=True)
        shutil.rmtree(self.folder / runfolder.FIGURES, ignore_errors=True)
        steps, apart = self.keeper.leave() if self.keeper is not None else (0, [])
        flaws = [f"later rows lie beside their tables in {', '.join(apart)}"] if apart else []
        try:
            self.write_manifest(status, problem, steps)
        except OSError:
            flaws.append(f"{runfolder.MANIFEST} found no room")
        return "".join(f", {flaw}" for flaw in flaws)

    def write_manifest(self, status: str, problem: str | None, steps: int) -> None:
        """Write the manifest as things stand."""
        inputs = self.looks.hashes() if self.looks is not None else {}
        rows = rows_of(self.folder) if status == runfolder.COMPLETE else {}
        facts = RunFacts(status, self.command, self.config.seed, steps, inputs, self.wall_s, problem, rows)
        write_manifest(self.folder / runfolder.MANIFEST, facts)

    def close(self) -> None:
        """Release the simulation."""
        if self.looks is not None:
            self.looks.close()

    def _loop(self, told: Looks, keeper: RunKeeper, quiet: bool) -> None:
        stream = Streams.from_seed(self.config.seed).tracker
        with progress_bar("tracking", told.expected_steps, quiet, before="loading the tracker") as advance:
            kept = (self.moment, keeper.diagnostics, keeper.particles, keeper.unseen)
            watchers = (*(each.watch for each in kept), lambda *_: advance())
            follow(told, tracker_builder(self.config), keeper.recorder, stream, watchers, self.times)
        if not self.steps:
            raise InputError(
                "the traffic has no ego vehicle in the section; choose another demand, density or duration"
            )

    def _pictured(self, looks: Looks, keeper: RunKeeper, scores: Mapping[str, Any]) -> Pictured:
        return Pictured(
            title=self.config.title(),
            road=looks.road,
            sensor=looks.sensor,
            errors=keeper.drawn_errors(),
            metrics=scores,
            moment=self.moment.moment,
            diagnostics=keeper.drawn_diagnostics(),
        )

    @contextmanager
    def _timed(self, phase: str) -> Iterator[None]:
        begin = perf_counter()
        try:
            yield
        finally:
            self.wall_s[phase] = self.wall_s.get(phase, 0.0) + perf_counter() - begin


def _opening(config: RunConfig) -> str:
    return "reading the recording" if config.replay is not None else "warming up traffic"


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Let no second Ctrl-C, SIGTERM or SIGHUP cut short what is being saved after the first."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    ends = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
    previous = [signal.signal(end, signal.SIG_IGN) for end in ends]
    try:
        yield
    finally:
        for end, handler in zip(ends, previous, strict=True):
            signal.signal(end, handler)
