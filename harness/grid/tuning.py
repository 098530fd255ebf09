"""Tunes the trackers' settings, all by one procedure and with one budget, so that nobody can say a rival was crippled.

    python -m harness.grid.tuning --tracker all --seeds 100:102 --duration 20 --trials 24 --processes 2 --write

Detections are recorded once, at two densities, on seeds that are never reported on (100 to 199), and every setting of
every tracker follows the same ones. A search begins at the tracker's defaults and moves one setting of
``tuning_spaces`` after the other up its ladder as long as that helps, then down, and so on until nothing helps; what is
left of the budget goes to pairs of settings drawn at random. So each tracker is tried the same number of times. The
objective is ``Trial.objective``. ``--write`` puts the outcome into ``harness/trackers/tuned.toml``, from which the
trackers take their defaults; mmpf's are defaults in its code, which are to be brought up to what the file says.
"""

from __future__ import annotations

import argparse
import itertools
import json
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from time import perf_counter

import numpy as np

from harness.config.model import RunConfig, SensorConfig
from harness.grid.pool import ONE_THREAD
from harness.grid.tuning_file import Outcome, write_outcome
from harness.grid.tuning_search import Options, Scores, Trial, best_of, search
from harness.grid.tuning_spaces import ALWAYS, SEARCH_SPACES, default_options, ladders, nested
from harness.running.follow import StageTimes, track
from harness.running.looks import Looks
from harness.running.open import open_looks
from harness.scoring import score_run
from harness.trackers.catalogue import TUNED_FILE, build_tracker

DENSITIES = (20.0, 45.0)
TUNING_SEEDS = range(100, 200)
TRIALS = 24

TryOn = Callable[[str, Options], Scores]


@dataclass(frozen=True)
class Recording:
    """One run's traffic and detections, that any number of trackers follow.

    Attributes:
        density: Vehicles per km and lane.
        seed: Root seed.
        duration_s: Length.
        sensor: Name of the sensor profile.
    """

    density: float
    seed: int
    duration_s: float
    sensor: str


@dataclass(frozen=True)
class Followed:
    """How one setting did on one recording.

    Attributes:
        scores: Its scores.
        ms_per_step: Mean time of a tracker step.
    """

    scores: Scores
    ms_per_step: float


def tune(tracker: str, budget: int, try_on: TryOn) -> list[Trial]:
    """Search a tracker's space.

    Args:
        tracker: Name of the tracker, one of ``SEARCH_SPACES``.
        budget: Number of settings to try, the defaults among them.
        try_on: Follows all recordings with a tracker of given options.

    Returns:
        All trials in the order they were made.
    """

    def score(options: Options) -> Trial:
        begin = perf_counter()
        trial = Trial(options, try_on(tracker, options))
        shown = json.dumps(options)
        sys.stderr.write(f"{tracker} {trial.objective:.2f} {trial.scores} {shown} {perf_counter() - begin:.0f} s\n")
        return trial

    return search(default_options(tracker), ladders(tracker), score, budget)


@contextmanager
def recordings_shared(recordings: Sequence[Recording], processes: int) -> Iterator[TryOn]:
    """Deal recordings out to processes, each of which makes its own once and keeps them.

    Args:
        recordings: What every setting is tried on.
        processes: How many work at a time; one works in this process.

    Yields:
        What follows all recordings with a tracker of given options.
    """
    if processes == 1:
        yield lambda tracker, options: mean_scores(follow_all(tracker, options, tuple(recordings)))
        return
    os.environ.update(ONE_THREAD)
    context = multiprocessing.get_context("spawn")
    shares = [tuple(recordings[first::processes]) for first in range(min(processes, len(recordings)))]
    with ExitStack() as stack:
        workers = [stack.enter_context(ProcessPoolExecutor(1, context)) for _ in shares]

        def try_on(tracker: str, options: Options) -> Scores:
            asked = [
                worker.submit(follow_all, tracker, options, share)
                for worker, share in zip(workers, shares, strict=True)
            ]
            return mean_scores(list(itertools.chain.from_iterable(each.result() for each in asked)))

        yield try_on


def mean_scores(followed: Sequence[Followed]) -> Scores:
    """Return the means over recordings; a score that a recording has none of is left out of its mean."""
    by_name = {name: [getattr(each.scores, name) for each in followed] for name in Scores.names()}
    return Scores(**{name: _mean(values) for name, values in by_name.items()})


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else float("nan")


def follow_all(tracker: str, options: Options, recordings: tuple[Recording, ...]) -> list[Followed]:
    """Follow recordings with a tracker of given options, dotted keys with values."""
    chosen = {**ALWAYS.get(tracker, {}), **nested(options)}
    return [_follow(tracker, chosen, recording) for recording in recordings]


def _follow(tracker: str, options: Options, recording: Recording) -> Followed:
    times = StageTimes()
    tables = track(
        _looks(recording), lambda setting: build_tracker(tracker, setting, options), recording.seed, times=times
    )
    metrics = score_run(tables.truth, tables.detections, tables.tracks, recording.seed).metrics
    return Followed(Scores.of(metrics), 1e3 * float(np.mean(times.tracker_s)))


@cache
def _looks(recording: Recording) -> Looks:
    traffic = {"net": "us101", "density": recording.density, "duration_s": recording.duration_s}
    config = {"seed": recording.seed, "traffic": traffic, "sensor": {"profile": recording.sensor}}
    return open_looks(RunConfig.model_validate(config)).kept()


def main(arguments: Sequence[str] | None = None) -> None:
    """Record, search and report from the command line."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    seeds, names = _seed_range(parser, chosen.seeds), _tracker_names(parser, chosen.tracker)
    if chosen.trials < 1 or chosen.processes < 1:
        parser.error("--trials and --processes: give 1 or more")
    recordings = [Recording(density, seed, chosen.duration, chosen.sensor) for density in DENSITIES for seed in seeds]
    with recordings_shared(recordings, chosen.processes) as try_on:
        for name in names:
            begin = perf_counter()
            trials = tune(name, chosen.trials, try_on)
            best = best_of(trials)
            seconds = perf_counter() - begin
            sys.stdout.write(
                f"{name}: {trials[0].objective:.2f} -> {best.objective:.2f} in {len(trials)} trials, {seconds:.0f} s: "
                f"{json.dumps(best.options)}\n"
            )
            sys.stdout.flush()
            if chosen.write:
                write_outcome(
                    Outcome(name, _command(name, chosen), [asdict(each) for each in recordings], trials), TUNED_FILE
                )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m harness.grid.tuning", description="Tune trackers' settings.")
    known = ", ".join(SEARCH_SPACES)
    parser.add_argument("--tracker", required=True, help=f"all, or names with commas between them: {known}")
    parser.add_argument("--seeds", default="100:102", help="A:B, B excluded, within 100:200")
    parser.add_argument("--duration", type=float, default=20.0, help="seconds of each recording")
    parser.add_argument("--sensor", default=SensorConfig().profile, help="sensor profile")
    parser.add_argument("--trials", type=int, default=TRIALS, help="settings tried for each tracker")
    parser.add_argument("--processes", type=int, default=1, help="recordings followed at a time")
    parser.add_argument("--write", action="store_true", help=f"put the outcome into {TUNED_FILE.name}")
    return parser


def _command(tracker: str, chosen: argparse.Namespace) -> str:
    return (
        f"python -m harness.grid.tuning --tracker {tracker} --seeds {chosen.seeds} --duration {chosen.duration:g} "
        f"--sensor {chosen.sensor} --trials {chosen.trials} --write"
    )


def _tracker_names(parser: argparse.ArgumentParser, text: str) -> list[str]:
    names = list(SEARCH_SPACES) if text == "all" else text.split(",")
    unknown = [name for name in names if name not in SEARCH_SPACES]
    if unknown:
        parser.error(f"--tracker {unknown[0]}: unknown; choose all, or from {', '.join(SEARCH_SPACES)}")
    return names


def _seed_range(parser: argparse.ArgumentParser, text: str) -> range:
    try:
        first, last = (int(part) for part in text.split(":"))
    except ValueError:
        parser.error(f"--seeds {text}: give two numbers as A:B")
    if first not in TUNING_SEEDS or last - 1 not in TUNING_SEEDS or first >= last:
        parser.error(f"--seeds {text}: tuning is done on seeds from 100 to 199 only")
    return range(first, last)


if __name__ == "__main__":
    # Under its own name, so that worker processes know the recordings that they are sent.
    from harness.grid.tuning import main as run

    run()
