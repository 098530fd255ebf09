"""One run from configuration to finished folder."""

from __future__ import annotations

import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

from harness.config.layers import write_config
from harness.config.model import RunConfig
from harness.errors import RunError, RunInterruptedError, UserError
from harness.runfolder import folder as runfolder
from harness.runfolder.manifest import RunFacts, write_manifest
from harness.runfolder.road import write_road
from harness.runfolder.tables import ColumnRecorder, RunTables, write_table
from harness.running.follow import AnyTracker, StageTimes, Streams, co_simulate
from harness.running.metrics import assemble_metrics
from harness.running.open import RunInputs, _build_tracker, check_gui, check_tracker, open_inputs
from harness.running.watchers import DiagnosticsKeeper, MomentKeeper, ParticleKeeper
from harness.scoring import ScoredRun, score_run
from harness.sensor.observation import Observation
from harness.truth.frame import Frame
from harness.writing.numbers import as_json
from harness.writing.progress import progress_bar
from mmpf.tracks import Tracks


@dataclass(frozen=True)
class FinishedRun:
    """A run that ended.

    Attributes:
        folder: Where its files lie.
        metrics: Content of its ``metrics.json``.
    """

    folder: Path
    metrics: dict[str, Any]


def run(
    config: RunConfig,
    *,
    out: Path | None = None,
    force: bool = False,
    command: str = "",
    quiet: bool = True,
    gui: bool = False,
) -> FinishedRun:
    """Simulate or replay, track, score, draw, and leave a run folder.

    Args:
        config: What to run.
        out: Where the folder goes; by default a name in ``results/`` that tells the main settings.
        force: Whether an earlier run in ``out`` may be replaced.
        command: What the user typed, for the manifest.
        quiet: Whether to leave out the progress bar.
        gui: Whether the traffic is shown in a window of sumo-gui while it is simulated; the results are the same.

    Raises:
        UserError: The input is wrong or no window can be opened; nothing is left behind.
        RunError: The run failed part-way; its finished steps lie in a folder that says so.
        RunInterruptedError: The user stopped the run; likewise.
    """
    check_tracker(config)
    if gui:
        check_gui(config)
    pending = runfolder.open_folder(out, config.default_folder_name(), force)
    attempt = _Attempt(config, pending.path, command, Streams.from_seed(config.seed), gui)
    try:
        metrics = attempt.complete(quiet)
        return FinishedRun(folder=pending.finish(), metrics=metrics)
    except UserError:
        pending.discard()
        raise
    except (KeyboardInterrupt, Exception) as error:
        if is_interrupt(error):
            raise _interrupted(attempt, pending) from None
        if isinstance(error, RunError) and not attempt.recorder.steps:
            pending.discard()
            raise
        folder = _leave(attempt, pending, runfolder.FAILED, traceback.format_exc())
        words = str(error) if isinstance(error, RunError) else f"{type(error).__name__}: {error}"
        raise RunError(
            f"the run failed after {attempt.recorder.steps} steps: {words}; the finished steps "
            f"and the traceback (manifest.json) are in {folder}"
        ) from error
    finally:
        attempt.close()


def is_interrupt(error: BaseException) -> bool:
    """Return whether Ctrl-C is behind an error: compiled code that it stops may raise a SystemError from it."""
    cause: BaseException | None = error
    while cause is not None:
        if isinstance(cause, KeyboardInterrupt):
            return True
        cause = cause.__cause__ or cause.__context__
    return False


def _interrupted(attempt: _Attempt, pending: runfolder.PendingFolder) -> RunInterruptedError:
    """Keep what was finished and return the error that says where."""
    if not attempt.recorder.steps:
        pending.discard()
        return RunInterruptedError("interrupted before the first step; nothing is kept")
    folder = _leave(attempt, pending, runfolder.INTERRUPTED, "interrupted by the user")
    return RunInterruptedError(f"interrupted after {attempt.recorder.steps} steps; the finished steps are in {folder}")


def _leave(attempt: _Attempt, pending: runfolder.PendingFolder, status: str, problem: str) -> Path:
    with _uninterrupted():
        attempt.write_tables(attempt.recorder.tables())
        attempt.write_manifest(status, problem)
        return pending.leave_incomplete()


@dataclass
class _Attempt:
    """A run on its way: what is known so far, and how to write it."""

    config: RunConfig
    folder: Path
    command: str
    streams: Streams
    gui: bool
    recorder: ColumnRecorder = field(default_factory=ColumnRecorder)
    moment: MomentKeeper = field(default_factory=MomentKeeper)
    diagnostics: DiagnosticsKeeper = field(default_factory=DiagnosticsKeeper)
    particles: ParticleKeeper = field(default_factory=ParticleKeeper)
    times: StageTimes = field(default_factory=StageTimes)
    wall_s: dict[str, float] = field(default_factory=dict)
    inputs: RunInputs | None = None

    def complete(self, quiet: bool) -> dict[str, Any]:
        """Do the whole run and return the metrics."""
        begin = perf_counter()
        write_config(self.config, self.folder / runfolder.CONFIG)
        with self._timed("open"):
            self.inputs = open_inputs(self.config, self.streams, self.gui)
        if self.inputs.report and not quiet:
            sys.stderr.write(self.inputs.report + "\n")
        write_road(self.inputs.truth.road, self.folder / runfolder.ROAD)
        with self._timed("loop"):
            self._loop(self.inputs, quiet)
        tables = self.recorder.tables()
        with self._timed("score"):
            scored = score_run(tables.truth, tables.detections, tables.tracks, self.config.seed)
        with self._timed("write"):
            self.write_tables(tables)
            write_table(scored.errors, self.folder / runfolder.ERRORS)
            write_table(scored.events, self.folder / runfolder.EVENTS)
        with self._timed("draw"):
            self._draw(scored)
        metrics = assemble_metrics(
            self.config,
            scored.metrics | dict(self.inputs.about),
            self.times,
            self.inputs.truth.step_s,
            perf_counter() - begin,
            tables.truth,
            self.inputs.truth.road,
            self.diagnostics.stages_ms,
        )
        (self.folder / runfolder.METRICS).write_text(as_json(metrics), encoding="utf-8")
        self.write_manifest(runfolder.COMPLETE, None)
        self._write_page()
        return metrics

    def write_tables(self, tables: RunTables) -> None:
        """Write the recorded tables."""
        write_table(tables.truth, self.folder / runfolder.TRUTH)
        write_table(tables.detections, self.folder / runfolder.DETECTIONS)
        write_table(tables.tracks, self.folder / runfolder.TRACKS)
        for kept, name in ((self.diagnostics, runfolder.DIAGNOSTICS), (self.particles, runfolder.PARTICLES)):
            table = kept.table()
            if table is not None:
                write_table(table, self.folder / name)

    def write_manifest(self, status: str, problem: str | None) -> None:
        """Write the manifest as things stand."""
        inputs = self.inputs.hashes() if self.inputs is not None else {}
        facts = RunFacts(
            status, self.command, self.config.seed, self.recorder.steps, inputs, self.wall_s, problem=problem
        )
        write_manifest(self.folder / runfolder.MANIFEST, facts)

    def close(self) -> None:
        """Release the simulation."""
        if self.inputs is not None:
            self.inputs.truth.close()

    def _loop(self, inputs: RunInputs, quiet: bool) -> None:
        with progress_bar("tracking", inputs.truth.expected_steps, quiet) as advance:

            def watch(frame: Frame, observation: Observation, tracks: Tracks, tracker: AnyTracker) -> None:
                self.moment.watch(frame, observation, tracks, tracker)
                self.diagnostics.watch(frame, observation, tracks, tracker)
                self.particles.watch(frame, observation, tracks, tracker)
                advance()

            co_simulate(
                inputs.truth,
                inputs.sensor,
                lambda setting: _build_tracker(self.config, setting),
                self.recorder,
                self.streams,
                watch,
                self.times,
            )
        if not self.recorder.steps:
            raise UserError("the traffic has no ego vehicle in the section; choose another demand, density or duration")

    def _write_page(self) -> None:
        from harness.report.page import write_run_page  # noqa: PLC0415

        write_run_page(self.folder)

    def _draw(self, scored: ScoredRun) -> None:
        from harness.report.figures import DIAGNOSTICS, diagnostics_figure, draw_figures  # noqa: PLC0415

        assert self.inputs is not None
        folder = self.folder / runfolder.FIGURES
        folder.mkdir()
        draw_figures(
            folder, self.moment.moment, self.inputs.truth.road, self.inputs.sensor.model(), scored, self.config.title()
        )
        diagnostics = self.diagnostics.table()
        if diagnostics is not None:
            diagnostics_figure(diagnostics, self.config.title()).savefig(folder / DIAGNOSTICS)

    @contextmanager
    def _timed(self, phase: str) -> Iterator[None]:
        begin = perf_counter()
        try:
            yield
        finally:
            self.wall_s[phase] = perf_counter() - begin


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Let no second Ctrl-C cut short what is being saved after the first."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
