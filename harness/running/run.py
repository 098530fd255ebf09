"""One run from configuration to finished folder; a finished run that is the same may be kept."""

from __future__ import annotations

import errno
import shutil
import traceback
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import pandas as pd

from harness.common.error_text import in_words
from harness.common.errors import InputError, RunError, RunInterruptedError
from harness.common.isolation import trusted
from harness.common.progress import progress_bar, working
from harness.common.signals import signals_held, told_to_end
from harness.common.streams import to_stderr
from harness.config.layers import config_from_table, leaves
from harness.config.model import RunConfig
from harness.running.evaluate import Evaluated, Evaluation, Keeper, evaluation_of
from harness.running.open import OpenSnapshots, check_named_code, open_snapshots
from harness.running.provenance import provenance_of
from harness.running.resolve import write_config, written_table
from harness.running.snapshots import SnapshotStream
from harness.running.watchers import DiagnosticsKeeper, MomentKeeper, ParticleKeeper, RunMoment
from harness.running.write import RunWriter
from harness.scoring.metrics.scarce import check_scored
from harness.storage import run_folder as runfolder
from harness.storage.manifest import CODE, INPUTS, check_unedited
from harness.storage.road_file import write_road
from harness.storage.tables import sampled_rows
from mmpf.map.road import Road
from mmpf.scan import SensorModel

NO_ROOM = (OSError, MemoryError)
MOST_DRAWN = 300_000
"""About how many rows of a table figures show at most: those of some steps of a long run."""


@dataclass(frozen=True)
class FinishedRun:
    """The folder of a run that ended, and the content of its ``metrics.json``."""

    folder: Path
    metrics: dict[str, Any]


@dataclass(frozen=True)
class Pictured:
    """What a run's figures show.

    Attributes:
        title: What was run, in a few words.
        errors: Rows of the error table, of a long run those of some steps.
        diagnostics: What the tracker told of each step; None of one that tells nothing.
    """

    title: str
    road: Road
    sensor: SensorModel
    errors: pd.DataFrame
    metrics: Mapping[str, Any]
    moment: RunMoment | None
    diagnostics: pd.DataFrame | None


@dataclass(frozen=True)
class Drawing:
    """Draws a run into its folder while that is not finished; handed in, since a run itself never draws."""

    figures: Callable[[Path, Pictured], object]
    page: Callable[[Path], object]


def run(
    config: RunConfig,
    *,
    out: Path | None = None,
    force: bool = False,
    resume: bool = False,
    command: str = "",
    quiet: bool = True,
    draw: Drawing | None = None,
    open_snapshots: OpenSnapshots = open_snapshots,
) -> FinishedRun:
    """Simulate or replay, track, score, draw, and leave a run folder.

    Args:
        out: Where the folder goes; by default a name in ``results/`` that tells the main settings.
        force: Whether an earlier run in ``out`` may be replaced.
        resume: Whether a finished run in ``out`` that is the same is kept.

    Raises:
        InputError: The input is wrong, no window can be opened or another run is in ``out``; nothing is left behind.
        RunError: The run failed part-way; its finished steps lie in a folder that says so. Or it is complete but for
            its pictures, for which there was no room; of others that fail a line on stderr tells.
        RunInterruptedError: The user stopped the run; likewise.
    """

    def tell(line: str) -> None:
        if line and not quiet:
            to_stderr(line)

    check_named_code(config)
    if resume and out is not None and (kept := kept_metrics(config, out, open_snapshots, tell)) is not None:
        return FinishedRun(out, kept)
    pending = runfolder.open_folder(out, config.default_folder_name(), force)
    attempt = _Attempt(config, pending.path, command)
    if pending.replaced is not None:
        tell(f"when this run is done it replaces {pending.replaced}")
    try:
        metrics = attempt.complete(open_snapshots, draw, quiet, tell)
        with signals_held(forgotten=True):
            finished = FinishedRun(folder=pending.finish(), metrics=metrics)
    except InputError:
        pending.discard()
        raise
    except (KeyboardInterrupt, Exception) as error:
        stopped = is_interrupt(error)
        closed = isinstance(error, OSError) and error.errno == errno.EBADF
        mend = f"see that the tracker {config.tracker.name} closes no file but its own" if closed else "make room"
        if not attempt.steps and (stopped or isinstance(error, RunError | OSError | MemoryError)):
            pending.discard()
            if stopped:
                raise RunInterruptedError("interrupted before the first step; nothing is kept") from None
            if isinstance(error, RunError):
                raise
            raise RunError(f"the run failed before its first step: {in_words(error)}; {mend}") from error
        status = runfolder.INTERRUPTED if stopped else runfolder.FAILED
        left = _leave(attempt, pending, status, "interrupted by the user" if stopped else traceback.format_exc())
        if stopped:
            raise RunInterruptedError(f"interrupted after {attempt.steps} steps; {left}") from None
        if runfolder.MANIFEST not in left:
            left = left.replace("steps are", f"steps and the traceback ({runfolder.MANIFEST}) are")
        fix = f"; {mend}" if isinstance(error, OSError | MemoryError) else ""
        raise RunError(f"the run failed after {attempt.steps} steps: {in_words(error)}{fix}; {left}") from error
    finally:
        attempt.close()
    if attempt.undrawn is not None:
        told = f"the run is complete in {finished.folder} but not drawn ({in_words(attempt.undrawn)})"
        again = f"`python -m harness report {finished.folder} --figures png`"
        if isinstance(attempt.undrawn, NO_ROOM):
            raise RunError(f"{told}; make room, then {again}") from attempt.undrawn
        to_stderr(f"warning: {told}; mend that, then {again}")
    return finished


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


def _leave(attempt: _Attempt, pending: runfolder.PendingFolder, status: str, problem: str) -> str:
    """Write the finished steps if the disk has room, and return a sentence on the result."""
    with signals_held(forgotten=True):
        try:
            flaws = attempt.leave(status, problem)
            left = pending.leave_incomplete()
            score = f"`python -m harness score --truth {left} --tracks {left}`"
            return f"the finished steps are in {left}{flaws}; {score} scores them"
        except (OSError, MemoryError) as error:
            # A folder that lacks some of its tables is of no use, and takes room that there is none of.
            pending.discard()
            return f"the finished steps could not be kept ({in_words(error)})"


class _Attempt:
    """A run on its way: what is known so far, and how to write it."""

    def __init__(self, config: RunConfig, folder: Path, command: str) -> None:
        self._config, self._folder = config, folder
        self._writer = RunWriter(folder, config.seed, command)
        self._evaluation: Evaluation | None = None
        self._snapshots: SnapshotStream | None = None
        self.undrawn: Exception | None = None

    @property
    def steps(self) -> int:
        """How many steps are finished."""
        return self._evaluation.steps if self._evaluation is not None else 0

    def complete(
        self, open_snapshots: OpenSnapshots, draw: Drawing | None, quiet: bool, tell: Callable[[str], object]
    ) -> dict[str, Any]:
        """Do the whole run and return the metrics."""
        begin = perf_counter()
        config, folder, writer = self._config, self._folder, self._writer
        write_config(config, folder / runfolder.CONFIG)
        opening = "reading the recording" if config.replay is not None else "warming up traffic"
        with writer.timed("open"), working(opening, quiet):
            snapshots = self._snapshots = open_snapshots(config)
        writer.code, models = provenance_of([config])
        writer.inputs = snapshots.hashes() | models
        tell(snapshots.report)
        write_road(snapshots.road, folder / runfolder.ROAD)
        moment, diagnostics = MomentKeeper(), DiagnosticsKeeper()
        keepers: dict[str, Keeper] = {runfolder.DIAGNOSTICS: diagnostics, runfolder.PARTICLES: ParticleKeeper()}
        evaluation = self._evaluation = evaluation_of(config, snapshots, keepers, writer)
        with writer.timed("loop"):
            with progress_bar("tracking", snapshots.expected_steps, quiet, before="loading the tracker") as advance:
                evaluation.follow((moment.watch, lambda *_: advance()))
            if not self.steps:
                raise InputError(
                    "the traffic has no ego vehicle in the section; choose another demand, density or duration"
                )
        # What was scored and written between two steps is in their own phases.
        writer.wall_s["loop"] -= writer.wall_s.get("score", 0.0) + writer.wall_s.get("write", 0.0)
        with working("scoring", quiet):
            evaluated = evaluation.finish()
            check_scored(evaluated.scores, self.steps, "net" if config.replay is None else "replay")
        if draw is not None:
            with writer.timed("draw"), working("drawing", quiet), self._drawing():
                draw.figures(folder / runfolder.FIGURES, self._pictured(snapshots, moment, evaluated))
        metrics = evaluated.metrics(config, snapshots.about, perf_counter() - begin, diagnostics.stages_ms)
        writer.finish(metrics, self.steps)
        if draw is not None and not isinstance(self.undrawn, NO_ROOM):
            with working("writing the page", quiet), trusted(), self._drawing():
                draw.page(folder)
        return metrics

    @contextmanager
    def _drawing(self) -> Iterator[None]:
        """Let pictures that fail be missing: what they show is there, and they can be drawn later."""
        try:
            yield
        except Exception as error:
            if is_interrupt(error):
                raise
            self.undrawn = error
            shutil.rmtree(self._folder / runfolder.FIGURES, ignore_errors=True)

    def leave(self, status: str, problem: str) -> str:
        """Write the unfinished run, and return a sentence on what is missing for lack of space."""
        rest = {} if self._evaluation is None else self._evaluation.recorded()
        return self._writer.leave(status, problem, self.steps, rest)

    def close(self) -> None:
        """Release the simulation."""
        if self._snapshots is not None:
            self._snapshots.close()

    def _pictured(self, snapshots: SnapshotStream, moment: MomentKeeper, evaluated: Evaluated) -> Pictured:
        told = self._folder / runfolder.DIAGNOSTICS
        return Pictured(
            title=self._config.title(),
            road=snapshots.road,
            sensor=snapshots.sensor,
            errors=sampled_rows(self._folder / runfolder.ERRORS, MOST_DRAWN),
            metrics=evaluated.scores,
            moment=moment.moment,
            diagnostics=sampled_rows(told, MOST_DRAWN) if told.is_file() else None,
        )


def kept_metrics(
    config: RunConfig, out: Path, open_snapshots: OpenSnapshots, tell: Callable[[str], object]
) -> dict[str, Any] | None:
    """Return the metrics of the finished run in a folder, or None if there is none and it has to be made.

    A run that was interrupted begins anew, since neither a simulator nor a tracker can go on in the middle.

    Args:
        open_snapshots: Opens the traffic, whose files are compared with those of the run.
        tell: Called with a sentence on what is kept.
    """
    if not out.exists():
        left = out.with_name(out.name + runfolder.INCOMPLETE_SUFFIX)
        interrupted = f"; the steps in {left} can't be continued and stay there" if left.is_dir() else ""
        tell(f"nothing is kept: there is no finished run in {out}{interrupted}")
        return None
    manifest = runfolder.read_manifest(out, "out")
    check_unedited(out, manifest, "out")
    tables = runfolder.read_config_table(out, "out"), written_table(config)
    before, now = (dict(leaves(config_from_table(table).model_dump(mode="json"))) for table in tables)
    keys = [key for key in dict.fromkeys((*before, *now)) if before.get(key) != now.get(key)]
    differs = ["the tracks there are a log's"] * bool(manifest.get("is_log"))
    differs += [f"{key} {before.get(key)} there, {now.get(key)} now" for key in keys]
    code, models = provenance_of([config])
    snapshots = open_snapshots(config)
    snapshots.close()
    for noted, found in ((manifest.get(CODE) or {}, code), (manifest.get(INPUTS) or {}, snapshots.hashes() | models)):
        names = dict.fromkeys((*noted, *found))  # a file that is gone decides no less than one that is new
        differs += [f"{name} has changed" for name in names if noted.get(name) != found.get(name)]
    if differs:
        raise InputError(
            f"`resume`: the run in {out} is another one ({'; '.join(differs)}); choose another `out`, or replace it by "
            "`force` without `resume`"
        )
    tell(f"the {manifest.get('steps', 'finished')} steps in {out} are kept, nothing is made")
    return runfolder.read_metrics(out, "out")
