"""Tunes the trackers' settings, all by one procedure and with one budget, so that nobody can say a rival was crippled.

    python -m harness.lab.tuning.search --tracker all --processes 2 --write

Detections are recorded once, on seeds that are never reported on (100 to 199): at two densities, and in free flow with
broken-down vehicles and with vehicles that are hard to detect, so that a tracker that withholds either pays for it.
Every setting of every tracker follows the same ones. ``trials`` is the search, ``spaces`` what it may
change; it begins at the trackers' defaults and at what was found before, and each tracker is tried the same number of
times. A setting counts only if the tracker passes the conformance checks with it; it is tried on one seed's recordings
after the other and stopped when it is behind. ``--write`` puts the outcome into ``harness/trackers/tuned.toml``, from
which the trackers take their defaults; mmpf's are defaults in its code, which are to be brought up to what the file
says.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import cache, partial
from time import perf_counter

from harness.common.errors import InputError
from harness.config.model import RunConfig, SensorConfig
from harness.grid.pool import ONE_THREAD
from harness.lab.tuning.spaces import ALWAYS, SEARCH_SPACES, Options, nested, space_of, starts_of
from harness.lab.tuning.trials import Scores, Trial, best_of, ends_near, load_optuna, scores_of, search, write_outcome
from harness.running.evaluate import evaluate
from harness.running.looks import Looks
from harness.running.open import open_looks
from harness.trackers.catalogue import TUNED_FILE, build_tracker
from harness.trackers.conformance.checks import check_tracker
from harness.trackers.conformance.requirements import TrackerCheckError

DENSITIES = (20.0, 45.0)
BROKEN_DOWN = (1, 3)
"""Broken-down vehicles of each recording that has some."""
FREE_FLOW, FREE_FLOW_S = 10.0, 30.0
"""Density and length of these recordings: the ego passes a standing vehicle in free flow, which takes a while."""
HARD_SHARE = 0.3
"""Share of their vehicles that are hard to detect."""
HARD_TO_DETECT = {"detectability_least": 0.35, "detectability_mean": 0.5, "detectability_spread": 0.08}
"""What makes a vehicle hard to detect: it is seen in about 35 to 60 % of scans."""
TUNING_SEEDS = range(100, 200)
TRIALS = 64


@dataclass(frozen=True)
class Recording:
    """One run's traffic and detections, that any number of trackers follow.

    Attributes:
        density: Vehicles per km and lane.
        seed: Root seed.
        duration_s: Length.
        sensor: Name of the sensor profile.
        broken_down: Vehicles that stand broken down in the main lanes.
        hard_share: Share of vehicles that are hard to detect, see ``HARD_TO_DETECT``.
    """

    density: float
    seed: int
    duration_s: float
    sensor: str
    broken_down: int = 0
    hard_share: float = 0.0


Batches = Sequence[Sequence[Recording]]


def tune(tracker: str, batches: Batches, budget: int) -> list[Trial]:
    """Search a tracker's space; return all trials.

    Args:
        tracker: Name of the tracker, one of ``SEARCH_SPACES``.
        batches: The recordings, in the batches in which they are followed.
        budget: Number of settings to try, the defaults among them.
    """
    begin = perf_counter()

    def tell(trial: Trial) -> None:
        until = f" refused for {trial.refused}" if trial.refused else ""
        until = f" stopped after {trial.batches}" if trial.stopped else until
        told = f"{tracker} {trial.objective:.2f}{until} {json.dumps(trial.scores)} {json.dumps(trial.options)}"
        sys.stderr.write(f"{told} {perf_counter() - begin:.0f} s\n")

    def follow_batch(options: Options, batch: int) -> list[Scores]:
        return [follow(tracker, options, recording) for recording in batches[batch]]

    check = partial(refusal, tracker)
    return search(starts_of(tracker), space_of(tracker), follow_batch, len(batches), budget, tell, check)


def refusal(tracker: str, options: Options) -> str:
    """Return which conformance checks a tracker of given options fails and how, or nothing."""
    try:
        check_tracker(partial(build_tracker, tracker, tuned=False), _chosen(tracker, options))
    except TrackerCheckError as finding:
        return "; ".join(str(finding).splitlines())
    return ""


def recordings_of(seed: int, duration_s: float, sensor: str) -> list[Recording]:
    """Return a seed's recordings: one for each density, and those in free flow with broken-down vehicles.

    Args:
        seed: Root seed.
        duration_s: Length of the first ones.
        sensor: Name of the sensor profile.
    """
    return [
        *(Recording(density, seed, duration_s, sensor) for density in DENSITIES),
        *(Recording(FREE_FLOW, seed, FREE_FLOW_S, sensor, broken, HARD_SHARE) for broken in BROKEN_DOWN),
    ]


def follow(tracker: str, options: Options, recording: Recording) -> Scores:
    """Follow a recording with a tracker of given options, dotted keys with values, whatever its tuned ones are."""
    build = partial(build_tracker, tracker, options=_chosen(tracker, options), tuned=False)
    return scores_of(evaluate(_looks(recording), build, recording.seed).scores)


def _chosen(tracker: str, options: Options) -> Options:
    return nested({**ALWAYS.get(tracker, {}), **options})


@cache
def _looks(recording: Recording) -> Looks:
    traffic = {
        "net": "us101", "density": recording.density, "duration_s": recording.duration_s,
        "broken_down": recording.broken_down,
    }  # fmt: skip
    hard = {"detectability_share": recording.hard_share, **HARD_TO_DETECT} if recording.hard_share else {}
    config = {"seed": recording.seed, "traffic": traffic, "sensor": {"profile": recording.sensor, **hard}}
    return open_looks(RunConfig.model_validate(config)).kept()


def main(arguments: Sequence[str] | None = None) -> None:
    """Record, search and report from the command line."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    seeds, names = _seed_range(parser, chosen.seeds), _tracker_names(parser, chosen.tracker)
    if chosen.trials < 1 or chosen.processes < 1:
        parser.error("--trials and --processes: give 1 or more")
    try:
        load_optuna()
        batches = [recordings_of(seed, chosen.duration, chosen.sensor) for seed in seeds]
        recordings = [asdict(each) for batch in batches for each in batch]
        for name, trials in _all_found(names, batches, chosen.trials, chosen.processes):
            sys.stdout.write(f"{_in_words(name, trials)}\n")
            sys.stdout.flush()
            if chosen.write:
                write_outcome(TUNED_FILE, name, _command(name, chosen), recordings, trials, space_of(name))
    except InputError as error:
        parser.error(str(error))


def _all_found(
    names: Sequence[str], batches: Batches, budget: int, processes: int
) -> Iterator[tuple[str, list[Trial]]]:
    """Yield what is found for each tracker; each process searches for one at a time, on recordings of its own."""
    search_one = partial(tune, batches=batches, budget=budget)
    if processes == 1 or len(names) == 1:
        yield from ((name, search_one(name)) for name in names)
        return
    os.environ.update(ONE_THREAD)
    with ProcessPoolExecutor(min(processes, len(names)), multiprocessing.get_context("spawn")) as pool:
        yield from zip(names, pool.map(search_one, names), strict=True)


def _in_words(name: str, trials: Sequence[Trial]) -> str:
    first, best = trials[0], best_of(trials)
    ends = ", ".join(f"{key} ({end})" for key, end in ends_near(best.options, space_of(name)).items())
    stopped, refused = sum(trial.stopped for trial in trials), sum(bool(trial.refused) for trial in trials)
    before = "refused" if first.refused else f"{first.objective:.2f}"
    return (
        f"{name}: {before} -> {best.objective:.2f} in {len(trials)} trials, "
        f"{stopped} of them stopped early, {refused} refused: {json.dumps(best.options)}; "
        f"at the end of its range: {ends or 'none'}"
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m harness.lab.tuning.search", description="Tune trackers' settings.")
    known = ", ".join(SEARCH_SPACES)
    parser.add_argument("--tracker", required=True, help=f"all, or names with commas between them: {known}")
    parser.add_argument("--seeds", default="100:104", help="A:B, B excluded, within 100:200")
    parser.add_argument("--duration", type=float, default=12.0, help="seconds of each recording at the two densities")
    parser.add_argument("--sensor", default=SensorConfig().profile, help="sensor profile")
    parser.add_argument("--trials", type=int, default=TRIALS, help="settings tried for each tracker")
    parser.add_argument("--processes", type=int, default=1, help="trackers searched for at a time")
    parser.add_argument("--write", action="store_true", help=f"put the outcome into {TUNED_FILE.name}")
    return parser


def _command(tracker: str, chosen: argparse.Namespace) -> str:
    return (
        f"python -m harness.lab.tuning.search --tracker {tracker} --seeds {chosen.seeds} "
        f"--duration {chosen.duration:g} --sensor {chosen.sensor} --trials {chosen.trials} --write"
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
    main()
