"""Tunes the settings of all trackers by one procedure and one budget.

    python -m harness.lab.tuning.search --tracker all --write

Detections are recorded once, on seeds that are never reported on (100 to 199): at two densities, and in free flow with
broken-down vehicles and with vehicles that are hard to detect, so that a tracker that withholds either pays for it.
Optuna's tree-structured Parzen estimator searches ``spaces`` from the defaults and from what was found before. A
setting counts only if the tracker passes the conformance checks with it; it is tried on one seed's recordings after
the other, and successive halving stops it when it is behind. ``--write`` puts the outcome into
``harness/trackers/tuned.toml``, from which the trackers take their defaults; mmpf's are defaults in its code, which are
to be brought up to what the file says.
"""

import argparse
import json
import sys
import tomllib
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import cache, partial
from importlib import import_module
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from harness.common.errors import InputError
from harness.common.files import write_text
from harness.common.isolation import end_with_parent
from harness.config.model import RunConfig, SensorConfig
from harness.lab.tuning import spaces
from harness.lab.tuning.spaces import Options, Space, nested
from harness.running.evaluate import evaluate
from harness.running.open import open_snapshots
from harness.running.snapshots import SnapshotStream
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

SCORES = {
    "hota": ("mot", "hota"),
    "idf1": ("mot", "idf1"),
    "hidden_cost_m": ("hidden", "hidden_cost_m"),
    "false_hidden_tracks_per_scan": ("hidden", "false_hidden_tracks_per_scan"),
    "plain_view_recall": ("in_plain_view", "recall"),
    "stopped_recall": ("in_plain_view", "stopped_recall"),
}
"""The scores that the objective is made of, and where a run's metrics hold them."""
OBJECTIVE = (
    "(hota + idf1) / 2 - 5 hidden_cost_m - 2 false_hidden_tracks_per_scan - 1 (100 - plain_view_recall) - "
    "0.5 (100 - stopped_recall), each where it is measured"
)
Scores = dict[str, float]


@dataclass(frozen=True)
class RecordedSnapshots:
    """One run's traffic and detections, that any number of trackers follow.

    Attributes:
        density: Vehicles per km and lane.
        hard_share: Share of vehicles that are hard to detect, see ``HARD_TO_DETECT``.
    """

    density: float
    seed: int
    duration_s: float
    sensor: str
    broken_down: int = 0
    hard_share: float = 0.0


@cache
def _snapshots(recording: RecordedSnapshots) -> SnapshotStream:
    traffic = {
        "net": "us101",
        "density": recording.density,
        "duration_s": recording.duration_s,
        "broken_down": recording.broken_down,
    }
    hard = {"detectability_share": recording.hard_share, **HARD_TO_DETECT} if recording.hard_share else {}
    config = {"seed": recording.seed, "traffic": traffic, "sensor": {"profile": recording.sensor, **hard}}
    return open_snapshots(RunConfig.model_validate(config)).kept()


def follow(tracker: str, options: Options, recording: RecordedSnapshots) -> Scores:
    """Return the scores of a tracker with given options, dotted keys with values, whatever its tuned ones are."""
    build = partial(build_tracker, tracker, options=nested(options), tuned=False)
    metrics = evaluate(_snapshots(recording), build, recording.seed).scores
    found = {name: metrics.get(group, {}).get(key) for name, (group, key) in SCORES.items()}
    return {name: float(value) for name, value in found.items() if value is not None and np.isfinite(value)}


def refusal(tracker: str, options: Options) -> str:
    """Return which conformance checks a tracker of given options fails and how, or nothing."""
    try:
        check_tracker(partial(build_tracker, tracker, tuned=False), nested(options))
    except TrackerCheckError as finding:
        return "; ".join(str(finding).splitlines())
    return ""


def mean_of(several: Sequence[Scores]) -> Scores:
    """Return the means over recordings; a score that a recording has none of is left out of its mean."""
    known = {name: [each[name] for each in several if name in each] for name in SCORES}
    return {name: float(np.mean(values)) for name, values in known.items() if values}


def objective_of(scores: Scores) -> float:
    """Return what the search maximises, see ``OBJECTIVE``.

    A false hidden track costs, else a tracker that keeps everything would be the best. Of stopped vehicles, ten
    percent that are withheld cost what doubting all that stands may gain.
    """
    cost = 5.0 * scores.get("hidden_cost_m", 0.0) + 2.0 * scores.get("false_hidden_tracks_per_scan", 0.0)
    withheld = 100.0 - scores.get("plain_view_recall", 100.0) + 0.5 * (100.0 - scores.get("stopped_recall", 100.0))
    return 0.5 * (scores["hota"] + scores["idf1"]) - cost - withheld


def search(
    starts: Sequence[Options],
    space: Space,
    follow_batch: Callable[[Options, int], Sequence[Scores]],
    batches: int,
    budget: int,
    refused: Callable[[Options], str] = lambda _: "",
) -> Any:  # noqa: ANN401
    """Search for the best setting; return Optuna's study, whose trials hold ``options`` and ``scores``.

    Args:
        follow_batch: Follows one batch of recordings with given options, and returns the scores on each.
        budget: Number of trials, those that are stopped among them.
        refused: Returns why a setting must not count, or nothing.

    Raises:
        InputError: Optuna is not installed, or no setting counts.
    """
    try:
        optuna: Any = import_module("optuna")
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "optuna":
            raise
        raise InputError("tuning needs Optuna: pip install -c constraints.txt '.[tuning]'") from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)

    def tried(trial: Any) -> float:  # noqa: ANN401
        options = _suggested(trial, space)
        trial.set_user_attr("options", options)
        if reason := refused(options):
            trial.set_user_attr("refused", reason)
            raise optuna.TrialPruned
        done: list[Scores] = []
        for batch in range(batches):
            done += follow_batch(options, batch)
            trial.set_user_attr("scores", mean_of(done))
            trial.report(objective_of(mean_of(done)), batch + 1)
            if batch + 1 < batches and trial.should_prune():
                raise optuna.TrialPruned
        return objective_of(mean_of(done))

    pruner = optuna.pruners.SuccessiveHalvingPruner(min_resource=1, reduction_factor=2)
    study = optuna.create_study(direction="maximize", sampler=optuna.samplers.TPESampler(seed=0), pruner=pruner)
    for start in starts:
        study.enqueue_trial({key: value for key, value in start.items() if _holds(space[key], value)})
    study.optimize(tried, n_trials=budget)
    if not any(trial.value is not None and trial.state.name == "COMPLETE" for trial in study.trials):
        reason = study.trials[0].user_attrs.get("refused")
        raise InputError(f"every setting was refused, the first one for {reason}; fix the tracker")
    return study


def _holds(values: spaces.Range | tuple[object, ...], value: object) -> bool:
    if isinstance(values, spaces.Range):
        return isinstance(value, int | float) and values.low <= value <= values.high
    return value in values


def _suggested(trial: Any, space: Space) -> Options:  # noqa: ANN401
    """Return the setting that Optuna asks for; switches come first, since what else is searched depends on them."""
    options: Options = {}
    for key in sorted(space, key=lambda key: not key.endswith(".on")):
        values = space[key]
        if not spaces.is_searched(key, options):
            continue
        if not isinstance(values, spaces.Range):
            options[key] = trial.suggest_categorical(key, values)
        elif values.whole:
            options[key] = trial.suggest_int(key, int(values.low), int(values.high))
        else:
            # More than three digits are not worth a reader's while.
            options[key] = float(f"{trial.suggest_float(key, values.low, values.high, log=values.log):.3g}")
    return options


def ends_near(options: Options, space: Space) -> dict[str, str]:
    """Return which settings lie at an end of their range, and at which: those ranges want to be wider."""
    ranges = {key: values for key, values in space.items() if isinstance(values, spaces.Range) and key in options}
    ends = {key: values.end_near(float(str(options[key]))) for key, values in ranges.items()}
    return {key: end for key, end in ends.items() if end is not None}


def write_outcome(
    path: Path,
    tracker: str,
    command: str,
    recordings: Sequence[Mapping[str, object]],
    study: Any,  # noqa: ANN401
    space: Space,
) -> None:
    """Put a search and its best setting into the TOML file of tuned settings; other trackers' entries stay."""
    best = study.best_trial
    tables = tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    tables[tracker] = {
        "command": command,
        "budget": len(study.trials),
        "objective_is": OBJECTIVE,
        "objective": best.value,
        **best.user_attrs["scores"],
        "at_an_end": sorted(ends_near(best.user_attrs["options"], space)),
        "searched": nested({key: list(values[:2]) for key, values in space.items()}),
        "recordings": list(recordings),
        "trials": [_told(trial) for trial in study.trials],
        # What a tracker takes from here is called options; what its code holds by itself is only told of.
        "found" if tracker in spaces.DEFAULTS_IN_CODE else "options": nested(best.user_attrs["options"]),
    }
    write_text(path, tomli_w.dumps(tables))


def _told(trial: Any) -> Options:  # noqa: ANN401
    """Return a trial as it is written: its setting with its objective, or why and after how many batches it ended."""
    attributes, last = trial.user_attrs, len(trial.intermediate_values)
    if "refused" in attributes:
        outcome: Options = {"refused": attributes["refused"]}
    else:
        outcome = {"objective": round(objective_of(attributes["scores"]), 3)}
    stopped = trial.state.name == "PRUNED" and last
    return {**outcome, **({"stopped_after": last} if stopped else {}), **nested(attributes["options"])}


def main(arguments: Sequence[str] | None = None) -> None:
    """Record, search and report from the command line."""
    parser = argparse.ArgumentParser(prog="python -m harness.lab.tuning.search", description="Tune trackers' settings.")
    names = ", ".join(spaces.SEARCH_SPACES)
    parser.add_argument("--tracker", required=True, help=f"all, or names with commas between them: {names}")
    parser.add_argument("--seeds", default="100:104", help="A:B, B excluded, within 100:200")
    parser.add_argument("--duration", type=float, default=12.0, help="seconds of each recording at the two densities")
    parser.add_argument("--sensor", default=SensorConfig().profile, help="sensor profile")
    parser.add_argument("--trials", type=int, default=TRIALS, help="settings tried for each tracker")
    parser.add_argument("--workers", type=int, default=2, help="processes, each with one recording at a time")
    parser.add_argument("--write", action="store_true", help=f"put the outcome into {TUNED_FILE.name}")
    chosen = parser.parse_args(arguments)
    first, _, last = chosen.seeds.partition(":")
    seeds = range(int(first), int(last)) if first.isdecimal() and last.isdecimal() else range(0)
    if not seeds or seeds[0] not in TUNING_SEEDS or seeds[-1] not in TUNING_SEEDS:
        parser.error(f"--seeds {chosen.seeds}: give A:B within 100:200; tuning uses no other seeds")
    trackers = list(spaces.SEARCH_SPACES) if chosen.tracker == "all" else chosen.tracker.split(",")
    if unknown := [name for name in trackers if name not in spaces.SEARCH_SPACES]:
        parser.error(f"--tracker {unknown[0]}: unknown; choose all, or from {names}")
    if chosen.trials < 1 or chosen.workers < 1:
        parser.error("--trials and --workers: give 1 or more")
    # Of each seed a recording for each density, and those in free flow with broken-down vehicles.
    batches = [
        [
            *(RecordedSnapshots(density, seed, chosen.duration, chosen.sensor) for density in DENSITIES),
            *(RecordedSnapshots(FREE_FLOW, seed, FREE_FLOW_S, chosen.sensor, n, HARD_SHARE) for n in BROKEN_DOWN),
        ]
        for seed in seeds
    ]
    recordings = [asdict(each) for batch in batches for each in batch]
    with ProcessPoolExecutor(chosen.workers, get_context("spawn"), end_with_parent) as pool:
        for name in trackers:

            def follow_batch(options: Options, batch: int, name: str = name) -> list[Scores]:
                return list(pool.map(partial(follow, name, options), batches[batch]))

            space = spaces.SEARCH_SPACES[name]
            try:
                study = search(
                    spaces.starts_of(name), space, follow_batch, len(batches), chosen.trials, partial(refusal, name)
                )
            except InputError as error:
                parser.error(f"{name}: {error}")
            best = study.best_trial
            ends = ", ".join(f"{key} ({end})" for key, end in ends_near(best.user_attrs["options"], space).items())
            told = f"{best.value:.2f} in {len(study.trials)} trials: {json.dumps(best.user_attrs['options'])}"
            sys.stdout.write(f"{name}: {told}; at the end of its range: {ends or 'none'}\n")
            if chosen.write:
                command = (
                    f"python -m harness.lab.tuning.search --tracker {name} --seeds {chosen.seeds} "
                    f"--duration {chosen.duration:g} --sensor {chosen.sensor} --trials {chosen.trials} --write"
                )
                write_outcome(TUNED_FILE, name, command, recordings, study, space)


if __name__ == "__main__":
    main()
