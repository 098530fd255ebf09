"""Evaluates a tracker: it tracks the snapshots, and what is recorded of it is scored part by part."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.common.numbers import without_nan
from harness.common.signals import signals_held
from harness.config.model import RunConfig
from harness.decisions.decide import driver_of
from harness.running.follow import StageTimes, TrackerBuilder, Watch, follow
from harness.running.metrics import TrafficSums, identification, timing_table
from harness.running.open import as_believed, tracker_builder
from harness.running.plausibility import warn_of_implausible
from harness.running.provenance import provenance_of
from harness.running.recorder import STRETCH_ROWS, ColumnRecorder
from harness.running.resolve import import_metrics, write_config
from harness.running.snapshots import RandomStreams, SnapshotStream
from harness.running.unseen import UnseenKeeper
from harness.running.watchers import DiagnosticsKeeper, ParticleKeeper
from harness.running.write import RunWriter
from harness.scoring.driving.asked import DriverSetup
from harness.scoring.metrics.registry import completed
from harness.scoring.score import RunScorer
from harness.storage import ownership
from harness.storage import run_folder as runfolder
from harness.storage.road_file import write_road
from mmpf.map.road import Road

Keeper = DiagnosticsKeeper | ParticleKeeper | UnseenKeeper


@dataclass(frozen=True)
class Evaluated:
    """A tracker's run that was followed and scored.

    Attributes:
        tables: What was recorded and what scoring made of it, by file; empty where it was written as the run went on.
        scores: The tables of scores by name, see ``harness.scoring.score.RunScorer``.
    """

    road: Road
    tables: Mapping[str, pd.DataFrame]
    scores: Mapping[str, Any]
    traffic: Mapping[str, Any]
    times: StageTimes
    step_s: float

    @property
    def steps(self) -> int:
        """How many steps there were."""
        return len(self.times.tracker_s)

    def metrics(
        self,
        config: RunConfig,
        about: Mapping[str, Any],
        total_s: float,
        stages_ms: Mapping[str, Sequence[float]] | None = None,
    ) -> dict[str, Any]:
        """Return the content of ``metrics.json``; a score that was not made is null, never absent."""
        tables = {
            "run": identification(config),
            **completed({**self.scores, **about}),
            "timing": timing_table(self.times, self.step_s, total_s, stages_ms),
            "traffic": self.traffic,
        }
        return dict(without_nan(tables))


@dataclass
class Evaluation:
    """An evaluation on its way.

    A run that is written as it goes on is never in memory but for one stretch. A run of a single stretch, as short ones
    are, is scored as a whole when it has ended. So is one whose metrics are not all in parts, however long it is.

    Attributes:
        driven: The road of the truth, and the driver that is asked on it; None asks no driver.
        writer: Writes each stretch; None keeps the run in memory.
    """

    snapshots: SnapshotStream
    build: TrackerBuilder
    seed: int
    driven: DriverSetup | None = None
    keepers: Mapping[str, Keeper] = field(default_factory=dict)
    writer: RunWriter | None = None
    times: StageTimes = field(default_factory=StageTimes)
    _tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    _told: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        """Prepare to record and to score."""
        self._road = self.snapshots.road if self.driven is None else self.driven.road
        self._timed: Callable[[str], AbstractContextManager[object]]
        self._timed = nullcontext if self.writer is None else self.writer.timed
        self._scorer, self._traffic = RunScorer(self.seed, self.driven), TrafficSums(self._road)
        in_stretches = self.writer is not None and self._scorer.takes_stretches
        self._recorder = ColumnRecorder(
            end_stretch=self._end_stretch if in_stretches else None, stretch_rows=STRETCH_ROWS
        )

    @property
    def steps(self) -> int:
        """How many steps are finished."""
        return self._recorder.steps

    def follow(self, watchers: Sequence[Watch] = (), stream: np.random.SeedSequence | None = None) -> None:
        """Follow the snapshots to their end; ``stream`` is the parent of the trackers' ones, None that of the seed."""
        stream = RandomStreams.from_seed(self.seed).tracker if stream is None else stream
        self._keep_room()
        watchers = (*watchers, *(keeper.watch for keeper in self.keepers.values()), self._keep_room)
        follow(self.snapshots, self.build, self._recorder, stream, watchers, self.times)

    def _keep_room(self, *_: object) -> None:
        if self.writer is not None:
            self.writer.keep_room({**self._recorder.size_bytes, runfolder.MANIFEST: 0})

    def recorded(self) -> dict[str, pd.DataFrame]:
        """Return what is kept and not scored yet, by file."""
        kept = {name: each.table() for name, each in self.keepers.items()}
        return self._recorder.tables() | {name: table for name, table in kept.items() if table is not None}

    def finish(self) -> Evaluated:
        """Score what was followed and return everything; what is written is finished."""
        self._end_stretch()
        with self._timed("score"):
            scores = self._scorer.metrics()
        if self.writer is not None:
            # Half put together, a table would get its later stretches twice from ``leave``.
            with self._timed("write"), signals_held():
                self.writer.close()
        return Evaluated(self._road, self._tables, scores, self._traffic.table(), self.times, self.snapshots.step_s)

    def _end_stretch(self) -> None:
        tables = self.recorded()
        if self.writer is None:
            self._forget()  # scoring needs the room
        with self._timed("score"):
            truth, detections, tracks = (
                tables[name] for name in (runfolder.TRUTH, runfolder.DETECTIONS, runfolder.TRACKS)
            )
            warn_of_implausible(tables, self._road, self._told)
            self._traffic.add(truth)
            tables |= self._scorer.add(truth, detections, tracks, tables.get(runfolder.UNSEEN))
        if self.writer is None:
            self._tables = tables
            return
        with self._timed("write"), signals_held():
            self.writer.append(tables)
            self._forget()

    def _forget(self) -> None:
        self._recorder.forget()
        for keeper in self.keepers.values():
            keeper.forget()


def evaluate(snapshots: SnapshotStream, build: TrackerBuilder, seed: int) -> Evaluated:
    """Follow snapshots with a tracker and score it; nothing but its tracks is used."""
    evaluation = Evaluation(snapshots, build, seed)
    evaluation.follow()
    return evaluation.finish()


def evaluation_of(
    config: RunConfig,
    snapshots: SnapshotStream,
    keepers: Mapping[str, Keeper] | None = None,
    writer: RunWriter | None = None,
) -> Evaluation:
    """Return the evaluation that a configuration describes; its tracker sees only what the configuration allows.

    Args:
        keepers: What is kept beside what every run keeps, by the file of its table.
    """
    import_metrics(config)
    told = as_believed(snapshots, config)
    kept: dict[str, Keeper] = {**(keepers or {}), runfolder.UNSEEN: UnseenKeeper(told.road, told.sensor)}
    driver, lanes = driver_of(config.decisions.driver), snapshots.road.graph
    # A driver is told who is ahead in its lane, so none is asked where no lanes are known.
    driven = DriverSetup(driver, snapshots.road) if not lanes or lanes.has_map else None
    return Evaluation(told, tracker_builder(config), config.seed, driven, kept, writer)


def write_run(
    folder: Path,
    evaluated: Evaluated,
    metrics: Mapping[str, Any],
    config: RunConfig,
    command: str,
    inputs: Mapping[str, str] | None = None,
    *,
    is_log: bool = False,
) -> None:
    """Write the folder of a run that is in memory, without pictures; half a folder is none.

    Args:
        command: What makes it again.
        inputs: SHA-256 of each input file.
        is_log: Whether the tracks are a log's.
    """
    (folder / runfolder.FIGURES).mkdir(parents=True, exist_ok=True)
    for name in (runfolder.MANIFEST, runfolder.PAGE, runfolder.BESIDE):  # the pages show the run that is replaced
        (folder / name).unlink(missing_ok=True)
    ownership.claim(folder, ownership.RUN)
    write_config(config, folder / runfolder.CONFIG)
    write_road(evaluated.road, folder / runfolder.ROAD)
    code, models = provenance_of([config])
    writer = RunWriter(folder, config.seed, command, {**(inputs or {}), **models}, code, is_log)
    writer.append(evaluated.tables)
    writer.finish(metrics, evaluated.steps)
    ownership.record_all(folder, ownership.RUN)
