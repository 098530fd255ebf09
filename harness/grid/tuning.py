"""Tunes the baselines' settings, so that nobody can say a rival was crippled.

    python -m harness.grid.tuning --tracker stonesoup-jpda --seeds 100:101 --write

Detections are recorded once, at two densities, on seeds that are never reported on (100 to 199), and every setting
follows the same ones. The search goes through the settings of ``SEARCH_SPACES`` one after the other: each value of one
is tried with all others as they stand, and the best stays. The objective is the mean of HOTA and IDF1 over vehicles in
sight, averaged over the recordings. ``--write`` puts the outcome into ``harness/trackers/tuned.toml``, from which the
trackers take their defaults.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from harness.config.model import RunConfig
from harness.running.follow import StageTimes, track
from harness.running.looks import Looks
from harness.running.open import open_looks
from harness.scoring import score_run
from harness.trackers.catalogue import TUNED_FILE, build_tracker, tuned_options

Options = dict[str, object]

DENSITIES = (20.0, 45.0)
TUNING_SEEDS = range(100, 200)

_STONE_SOUP_SPACE: dict[str, tuple[object, ...]] = {
    "lon_noise": (0.3, 1.0, 3.0),
    "lat_noise": (0.03, 0.1, 0.3),
    "gate_std": (3.0, 3.9, 5.0),
    "longest_unseen_s": (2.0, 5.0),
    "confirm_detections": (2, 3),
}
SEARCH_SPACES: dict[str, dict[str, tuple[object, ...]]] = {
    "stonesoup-gnn": _STONE_SOUP_SPACE,
    "stonesoup-jpda": {
        "detection_probability": (0.5, 0.7, 0.9),
        "gate_std": (3.0, 3.9, 5.0),
        "lon_noise": (0.3, 1.0, 3.0),
        "lat_noise": (0.01, 0.03, 0.1),
        "longest_unseen_s": (2.0, 5.0),
    },
    "stonesoup-particle": {name: _STONE_SOUP_SPACE[name] for name in ("lat_noise", "lon_noise")},
    "oracle-kalman": {
        "lon_noise": (0.1, 0.3, 1.0, 3.0),
        "lat_noise": (0.01, 0.03, 0.1, 0.3),
        "longest_unseen_s": (5.0, 10.0),
    },
}
_STONE_SOUP_START: Options = {
    "lon_noise": 1.0,
    "lat_noise": 0.1,
    "gate_std": 3.9,
    "longest_unseen_s": 5.0,
    "confirm_detections": 3,
}
STARTS: dict[str, Options] = {
    "stonesoup-gnn": _STONE_SOUP_START,
    "stonesoup-jpda": {"detection_probability": 0.5, **_STONE_SOUP_START, "lat_noise": 0.03},
    "stonesoup-particle": _STONE_SOUP_START,
    "oracle-kalman": {"lon_noise": 1.0, "lat_noise": 0.1, "longest_unseen_s": 10.0},
}
"""Where each search begins."""

START_FROM = {"stonesoup-particle": "stonesoup-gnn"}
"""Trackers whose search begins at another's tuned settings."""

ALWAYS: dict[str, Options] = {name: {"coarse_gate": True} for name in STARTS if name.startswith("stonesoup")}
"""Options that save the search time and change no tracks, or only their random draws."""

SAME_AS = {"stonesoup-jpda-stitched": "stonesoup-jpda"}
"""Trackers that take another's tuned settings, so that the two differ in one thing only."""


@dataclass(frozen=True)
class Recording:
    """Truth and observations of one run, played back to any number of trackers.

    Attributes:
        density: Vehicles per km and lane.
        seed: Root seed.
        looks: The frames with what the sensor made of them, kept.
    """

    density: float
    seed: int
    looks: Looks


@dataclass(frozen=True)
class Trial:
    """One setting and how well it did.

    Attributes:
        options: The tracker's options.
        hota: HOTA in sight, percent, mean over the recordings.
        idf1: IDF1 in sight, percent, likewise.
        ms_per_step: Mean time of a tracker step.
    """

    options: Options
    hota: float
    idf1: float
    ms_per_step: float

    @property
    def objective(self) -> float:
        """What the search maximises."""
        return 0.5 * (self.hota + self.idf1)


def tune(tracker: str, recordings: Sequence[Recording]) -> list[Trial]:
    """Search a tracker's space, one setting after the other.

    Args:
        tracker: Name of the tracker, one of ``SEARCH_SPACES``.
        recordings: What every setting is tried on.

    Returns:
        All trials in the order they were made.
    """
    best = try_options(tracker, STARTS[tracker] | tuned_options(START_FROM.get(tracker, "")), recordings)
    trials = [best]
    for option, values in SEARCH_SPACES[tracker].items():
        candidates = [best.options | {option: value} for value in values]
        for options in candidates:
            if all(options != trial.options for trial in trials):
                trials.append(try_options(tracker, options, recordings))
        best = max(trials, key=lambda trial: trial.objective)
    return trials


def try_options(tracker: str, options: Mapping[str, object], recordings: Sequence[Recording]) -> Trial:
    """Follow all recordings with one setting."""
    scores, times = [], StageTimes()
    chosen = {**ALWAYS.get(tracker, {}), **options}
    for recording in recordings:
        tables = track(
            recording.looks, lambda setting: build_tracker(tracker, setting, chosen), recording.seed, times=times
        )
        scored = score_run(tables.truth, tables.detections, tables.tracks, recording.seed).metrics["mot"]
        scores.append((scored["hota"], scored["idf1"]))
    hota, idf1 = np.mean(scores, axis=0).tolist()
    trial = Trial(dict(options), hota, idf1, 1e3 * float(np.mean(times.tracker_s)))
    sys.stderr.write(f"{tracker} {trial.objective:.2f} {json.dumps(trial.options)} {trial.ms_per_step:.1f} ms\n")
    return trial


def record(density: float, seed: int, duration_s: float) -> Recording:
    """Simulate traffic and sensor without a tracker."""
    config = RunConfig.model_validate(
        {"seed": seed, "traffic": {"net": "us101", "density": density, "duration_s": duration_s}}
    )
    return Recording(density, seed, open_looks(config).kept())


def write_outcome(tracker: str, trials: Sequence[Trial], recordings: Sequence[Recording], path: Path) -> None:
    """Put a tracker's best setting and the whole search into the file of tuned settings.

    Args:
        tracker: Name of the tracker.
        trials: The search.
        recordings: What it was made on.
        path: The TOML file; other trackers' entries stay.
    """
    lines = _other_tables(path, {tracker, *(heir for heir, source in SAME_AS.items() if source == tracker)})
    best = max(trials, key=lambda trial: trial.objective)
    lines += _table(tracker, best, trials, recordings)
    for heir, source in SAME_AS.items():
        if source == tracker:
            lines += [f"[{heir}]", f"same_as = {json.dumps(tracker)}", "", *_options_table(heir, best.options)]
    path.write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")


def _table(tracker: str, best: Trial, trials: Sequence[Trial], recordings: Sequence[Recording]) -> list[str]:
    made_on = [
        {"density": recording.density, "seed": recording.seed, "steps": recording.looks.expected_steps}
        for recording in recordings
    ]
    return [
        f"[{tracker}]",
        f"objective = {best.objective:.3f}",
        f"hota = {best.hota:.3f}",
        f"idf1 = {best.idf1:.3f}",
        "recordings = [",
        *(f"  {_inline(entry)}," for entry in made_on),
        "]",
        "trials = [",
        *(f"  {_inline({'objective': round(trial.objective, 3), **trial.options})}," for trial in trials),
        "]",
        "",
        *_options_table(tracker, best.options),
    ]


def _options_table(tracker: str, options: Mapping[str, object]) -> list[str]:
    return [f"[{tracker}.options]", *(f"{name} = {json.dumps(value)}" for name, value in options.items()), ""]


def _inline(entry: Mapping[str, object]) -> str:
    return "{ " + ", ".join(f"{name} = {json.dumps(value)}" for name, value in entry.items()) + " }"


def _other_tables(path: Path, replaced: set[str]) -> list[str]:
    kept, keep = [], True
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        if line.startswith("["):
            keep = line.strip("[]").removesuffix(".options") not in replaced
        if keep:
            kept.append(line)
    return [*kept, ""] if kept and kept[-1] else kept


def main(arguments: Sequence[str] | None = None) -> None:
    """Record, search and report from the command line."""
    parser = argparse.ArgumentParser(
        prog="python -m harness.grid.tuning", description="Tune a baseline tracker's settings."
    )
    parser.add_argument("--tracker", required=True, choices=sorted(SEARCH_SPACES))
    parser.add_argument("--seeds", default="100:101", help="A:B, B excluded, within 100:200")
    parser.add_argument("--duration", type=float, default=20.0, help="seconds of each recording")
    parser.add_argument("--write", action="store_true", help=f"put the outcome into {TUNED_FILE.name}")
    chosen = parser.parse_args(arguments)
    seeds = _seed_range(parser, chosen.seeds)
    recordings = [record(density, seed, chosen.duration) for density in DENSITIES for seed in seeds]
    begin = perf_counter()
    trials = tune(chosen.tracker, recordings)
    best = max(trials, key=lambda trial: trial.objective)
    sys.stdout.write(f"{json.dumps(best.options)}: {best.objective:.2f} after {perf_counter() - begin:.0f} s\n")
    if chosen.write:
        write_outcome(chosen.tracker, trials, recordings, TUNED_FILE)


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
