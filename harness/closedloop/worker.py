"""One worker process: simulates a seed's traffic up to each start, then forks and drives by each belief.

A fork holds the very simulation as it stands there, drivers' memories and random numbers included, so every belief
begins with the same bytes. SUMO's saved states do not: what ``saveState`` wrote and ``loadState`` read goes on
otherwise each time, since the drivers' own estimates are not in it, nor what was set of them at run time.
"""

import os
import pickle
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any, TypeVar, cast

import numpy as np

from harness.closedloop.episode import run_episode
from harness.closedloop.episode_start import EpisodeStart, episode_starts
from harness.closedloop.plan import PlannedDrive, flow_of
from harness.closedloop.traffic import LiveTraffic
from harness.common.errors import InputError, RunError
from harness.common.files import full_disk
from harness.common.isolation import ProcessLimits, end_with_parent, streamed
from harness.grid.cells import Cell, failed_row, finished_row
from harness.grid.worker import CELL, RUN, STEPPING, CellDone, Finished, Message, Report, Started, serve
from harness.running.evaluate import evaluation_of, write_run
from harness.running.snapshots import RandomStreams, SnapshotStream
from harness.scoring.metrics.closedloop import NO_CANDIDATE
from harness.sensor.detector import build_sensor
from harness.sensor.observation import Snapshot
from harness.sensor.profiles import sensor_settings
from harness.storage.grid_folder import Row
from harness.truth.network.names import shipped_networks
from harness.truth.network.network import load_network
from harness.truth.sumo.simulation import SumoTruth, open_traffic

T = TypeVar("T")
DRIVING = ProcessLimits(memory_bytes=8 << 30, cpu_s=120, file_bytes=8 << 30)
"""Of a cell on a network from elsewhere, whose trackers are in its process."""
REHEARSED_STEPS = 3
CHOICES = 9
"""Stream of the choices between candidates."""


def work_on_cell(cell: Cell, report: Report) -> None:
    """Drive all episodes of a seed by all beliefs, reporting in order; for an external network in a confined fork."""
    net, begin = cell.config.traffic.net, perf_counter()
    if net in shipped_networks():
        _work_on(cell, report, lambda: None)
        return
    left = {run.key: run for run in cell.runs if isinstance(run, PlannedDrive)}
    try:
        with TemporaryDirectory(prefix="harness-sumo-") as scratch:
            folders = [Path(scratch), *([] if cell.keep_in is None else [cell.keep_in.absolute()])]
            folders[-1].mkdir(parents=True, exist_ok=True)
            told: Generator[Message] = streamed(
                lambda send: _work_on(cell, send, lambda: send(None)), f"`net`: {net}", DRIVING, folders
            )
            for message in told:
                report(message)
                if isinstance(message, Finished):
                    left.pop(message.key, None)
    except (InputError, RunError, OSError) as error:
        for run in left.values():
            report(Finished(run.key, failed_row(run, str(error), perf_counter() - begin, error)))
        report(CellDone())


def _work_on(cell: Cell, report: Callable[[Any], None], on_step: Callable[[], None]) -> None:
    report(Started(CELL))
    begin = perf_counter()
    left = {run.key: run for run in cell.runs if isinstance(run, PlannedDrive)}
    try:
        with opened(cell, on_step) as traffic:
            for at in _episodes(traffic, cell):
                kind = at if isinstance(at, str) else at.kind
                for run in [each for each in left.values() if each.kind == kind]:
                    report(Started(RUN, run.key))
                    row = _no_candidate(run) if isinstance(at, str) else _driven(traffic, at, run, cell.keep_in, report)
                    report(Finished(run.key, row))
                    del left[run.key]
    except Exception as error:
        for run in left.values():
            report(Finished(run.key, failed_row(run, _reason(error), perf_counter() - begin, error)))
    report(CellDone())


@contextmanager
def opened(cell: Cell, on_step: Callable[[], None] = lambda: None) -> Iterator[LiveTraffic]:
    """Yield the warmed-up traffic of a cell, and end it."""
    config = cell.config
    network = load_network(config.traffic.net)
    truth = open_traffic(
        network,
        demand=config.traffic.density if config.traffic.demand is None else config.traffic.demand,
        duration_s=0.0,
        seed=RandomStreams.from_seed(config.seed).truth,
        ego=False,
        broken_down=config.traffic.broken_down,
        flow_mps=flow_of(cell),
        on_step=on_step,
    )
    try:
        assert isinstance(truth, SumoTruth)
        yield LiveTraffic(truth, network)
    finally:
        truth.close()


def in_fork(work: Callable[[], T]) -> T:
    """Return what work returns that is done in a fork of this process; nothing that it does is seen here.

    Raises:
        RunError: It fails.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        _answer(work, reading, writing)
    os.close(writing)
    with os.fdopen(reading, "rb") as answers:
        answer = answers.read()
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if not answer:
        raise RunError(f"the fork that drove it died (exit code {status})")
    succeeded, result = pickle.loads(answer)
    if not succeeded:
        raise RunError(result[0]) from result[1]
    return cast("T", result)


def main() -> None:
    """Work on cells of a closed loop; see ``harness.grid.worker.serve``."""
    serve(work_on_cell)


def _answer(work: Callable[[], object], reading: int, writing: int) -> None:
    """Do the work of a fork and end the process, whatever happens."""
    code = 1
    try:
        os.close(reading)
        # An owner that is killed must not leave forks behind.
        end_with_parent()
        try:
            answer = pickle.dumps((True, work()))
        except Exception as error:
            answer = pickle.dumps((False, (_reason(error), full_disk(error))))
        with os.fdopen(writing, "wb") as pipe:
            pipe.write(answer)
        code = 0
    finally:
        os._exit(code)


def _episodes(traffic: LiveTraffic, cell: Cell) -> Iterator[EpisodeStart | str]:
    kinds = list(dict.fromkeys(run.kind for run in cell.runs if isinstance(run, PlannedDrive)))
    sensor = cell.config.sensor
    rng = np.random.default_rng(np.random.SeedSequence(cell.config.seed, spawn_key=(CHOICES,)))
    return episode_starts(traffic, kinds, sensor_settings(sensor.profile, sensor.overrides), rng, flow_of(cell))


def _driven(traffic: LiveTraffic, at: EpisodeStart, run: PlannedDrive, keep_in: Path | None, report: Report) -> Row:
    """Return the row of one drive; of one that ends in a collision a run folder is kept."""
    begin = perf_counter()
    try:
        _rehearse(traffic, at, run)
        report(Started(STEPPING, run.key))
        table, evaluated = in_fork(lambda: run_episode(traffic, at, run))
        if evaluated is not None and keep_in is not None:
            metrics = evaluated.metrics(run.config, table, sum(evaluated.times.tracker_s))
            # No ``run`` makes it again, since the ego was driven by a belief.
            write_run(keep_in / run.key, evaluated, metrics, run.config, f"harness drive: episode {run.key}")
        # What took how long would make every table another.
        return finished_row(run, table, 0.0) | {"total_s": None}
    except Exception as error:
        return failed_row(run, _reason(error), perf_counter() - begin, error)


def _no_candidate(run: PlannedDrive) -> Row:
    return finished_row(run, {"drive": {"ended": NO_CANDIDATE}}, 0.0) | {"total_s": None}


def _rehearse(traffic: LiveTraffic, at: EpisodeStart, run: PlannedDrive) -> None:
    """Load and compile here what a tracker needs, for all forks to come."""
    config = run.config
    sensor, road = build_sensor(sensor_settings(config.sensor.profile, config.sensor.overrides)), traffic.network.road
    rng = np.random.default_rng(0)
    snapshots = tuple(Snapshot(frame, sensor.observe(frame, road, rng)) for frame in at.frames[:REHEARSED_STEPS])
    evaluation_of(config, SnapshotStream(road, traffic.step_s, len(snapshots), sensor.model(road), snapshots)).follow()


def _reason(error: Exception) -> str:
    return str(error) if isinstance(error, RunError) else f"{type(error).__name__}: {error}"
