"""The search for a tracker's settings: Optuna's tree-structured Parzen estimator with successive halving.

A trial keeps most of the best setting's values, and Optuna chooses the others: with a dozen or more values to choose
and a budget of some dozens of trials, choosing all of them anew finds less. Each setting is tried on the recordings
batch by batch; one that is behind half of those tried so far is stopped. One that fails a conformance check is refused
before any recording is followed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import InputError
from harness.common.files import write_text
from harness.lab.tuning.spaces import DEFAULTS_IN_CODE, Options, Range, Space, is_searched

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
_KEPT = 0.75

Scores = dict[str, float]


def scores_of(metrics: Mapping[str, Any]) -> Scores:
    """Take the scores out of a run's metrics; what is not measured is left out."""
    found = {name: metrics.get(group, {}).get(key) for name, (group, key) in SCORES.items()}
    return {name: float(value) for name, value in found.items() if value is not None and np.isfinite(value)}


def mean_of(several: Sequence[Scores]) -> Scores:
    """Return the means over recordings; a score that a recording has none of is left out of its mean."""
    known = {name: [each[name] for each in several if name in each] for name in SCORES}
    return {name: float(np.mean(values)) for name, values in known.items() if values}


@dataclass(frozen=True)
class Trial:
    """One setting and how well it did.

    Attributes:
        options: The tracker's options by dotted key.
        scores: Its scores, means over the recordings that it was tried on.
        batches: On how many batches of recordings it was tried.
        stopped: Whether it was stopped before the last one.
        refused: Why it was refused, empty if it was not.
    """

    options: Options
    scores: Scores = field(default_factory=dict)
    batches: int = 1
    stopped: bool = False
    refused: str = ""

    @property
    def objective(self) -> float:
        """What the search maximises, see ``OBJECTIVE``.

        A false hidden track costs, else a tracker that keeps everything would be the best. Of stopped vehicles, ten
        percent that are withheld cost what doubting all that stands may gain.
        """
        told = self.scores
        if self.refused:
            return math.nan
        cost = 5.0 * told.get("hidden_cost_m", 0.0) + 2.0 * told.get("false_hidden_tracks_per_scan", 0.0)
        withheld = 100.0 - told.get("plain_view_recall", 100.0) + 0.5 * (100.0 - told.get("stopped_recall", 100.0))
        return 0.5 * (told["hota"] + told["idf1"]) - cost - withheld

    @property
    def counts(self) -> bool:
        """Whether it may be the best: it was neither stopped nor refused."""
        return not (self.stopped or self.refused)


def best_of(trials: Sequence[Trial]) -> Trial:
    """Return the best trial that counts, the earliest of equals.

    Raises:
        InputError: None counts.
    """
    counting = [trial for trial in trials if trial.counts]
    if not counting:
        raise InputError(f"every setting was refused, the first one for {trials[0].refused}; fix the tracker")
    return max(counting, key=lambda trial: trial.objective)


def ends_near(options: Options, space: Space) -> dict[str, str]:
    """Return which settings lie at an end of their range, and at which: those ranges want to be wider."""
    ranges = {key: values for key, values in space.items() if isinstance(values, Range) and key in options}
    ends = {key: values.end_near(float(str(options[key]))) for key, values in ranges.items()}
    return {key: end for key, end in ends.items() if end is not None}


def search(
    starts: Sequence[Options],
    space: Space,
    follow: Callable[[Options, int], Sequence[Scores]],
    batches: int,
    budget: int,
    tell: Callable[[Trial], object],
    refusal: Callable[[Options], str] = lambda _: "",
) -> list[Trial]:
    """Search for the best setting; return all trials in the order they were made.

    Args:
        starts: The settings that are tried first.
        space: The values of each setting.
        follow: Follows one batch of recordings with given options, and returns the scores on each.
        batches: How many batches there are.
        budget: Number of trials, those that are stopped among them.
        tell: Is called with every trial.
        refusal: Returns why a setting must not count, or nothing.

    Raises:
        InputError: Optuna is not installed, or every setting that the search begins at is refused.
    """
    optuna, rng = load_optuna(), np.random.default_rng(0)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    sampler = optuna.samplers.TPESampler(seed=0, multivariate=False)
    pruner = optuna.pruners.SuccessiveHalvingPruner(min_resource=1, reduction_factor=2)
    study = optuna.create_study(direction="maximize", sampler=sampler, pruner=pruner)
    trials: list[Trial] = []
    while len(trials) < budget:
        if len(trials) < len(starts):
            kept, like = set(space), starts[len(trials)]
        else:
            kept, like = _kept(list(space), rng), best_of(trials).options
        study.enqueue_trial({key: like[key] for key in kept & like.keys() if _holds(space[key], like[key])})
        asked = study.ask()
        options = _suggested(asked, space, kept, like)
        reason = refusal(options)
        trial = Trial(options, {}, 0, refused=reason) if reason else _tried(options, follow, batches, asked)
        trials.append(trial)
        if trial.counts:
            study.tell(asked, trial.objective)
        else:
            study.tell(asked, state=optuna.trial.TrialState.PRUNED)
        tell(trial)
    return trials


def load_optuna() -> Any:  # noqa: ANN401
    """Return Optuna.

    Raises:
        InputError: It is not installed.
    """
    try:
        return import_module("optuna")
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "optuna":
            raise
        raise InputError("tuning needs Optuna, which is not installed: pip install '.[tuning]'") from None


def _kept(keys: Sequence[str], rng: np.random.Generator) -> set[str]:
    """Return which settings stay as they are: most of them, and never all."""
    changed = keys[int(rng.integers(len(keys)))]
    return {key for key in keys if rng.random() < _KEPT and key != changed}


def _holds(values: Range | tuple[object, ...], value: object) -> bool:
    return values.holds(value) if isinstance(values, Range) else value in values


def _tried(options: Options, follow: Callable[..., Sequence[Scores]], batches: int, asked: Any) -> Trial:  # noqa: ANN401
    """Return how well a setting did; it is stopped when Optuna says so."""
    done: list[Scores] = []
    for batch in range(1, batches + 1):
        done += follow(options, batch - 1)
        trial = Trial(options, mean_of(done), batch)
        if batch < batches:
            asked.report(trial.objective, batch)
            if asked.should_prune():
                return Trial(options, trial.scores, batch, stopped=True)
    return trial


def _suggested(asked: Any, space: Space, kept: Collection[str], like: Options) -> Options:  # noqa: ANN401
    """Return a setting that has some values of another, and none where that one has none; Optuna chooses the rest.

    A group that the other has switched off has no values there: when it is switched on, Optuna chooses all of them.
    """
    options: Options = {}
    # Switches come first, since it depends on them what else is asked for.
    for key in sorted(space, key=lambda key: not key.endswith(".on")):
        left_out = key in kept and key not in like and is_searched(key, like)
        if not is_searched(key, options) or left_out:
            continue
        values = space[key]
        if key in kept and key in like and not _holds(values, like[key]):
            options[key] = like[key]
        elif not isinstance(values, Range):
            options[key] = asked.suggest_categorical(key, values)
        elif values.whole:
            options[key] = asked.suggest_int(key, int(values.low), int(values.high))
        else:
            # More than three digits are not worth a reader's while.
            options[key] = float(f"{asked.suggest_float(key, values.low, values.high, log=values.log):.3g}")
    return options


def write_outcome(
    path: Path,
    tracker: str,
    command: str,
    recordings: Sequence[Mapping[str, object]],
    trials: Sequence[Trial],
    space: Space,
) -> None:
    """Put a search and its best setting into the TOML file of tuned settings; other trackers' entries stay."""
    best, first = best_of(trials), trials[0]
    told = [
        ({"refused": trial.refused} if trial.refused else {"objective": round(trial.objective, 3)})
        | ({"stopped_after": trial.batches} if trial.stopped else {})
        | trial.options
        for trial in trials
    ]
    searched = {
        key: [values.low, values.high] if isinstance(values, Range) else values for key, values in space.items()
    }
    # What a tracker takes from here is called options; what its code holds by itself is only told of.
    options = "found" if tracker in DEFAULTS_IN_CODE else "options"
    lines = [
        *_other_tables(path, tracker),
        f"[{tracker}]",
        f"command = {json.dumps(command)}",
        f"budget = {len(trials)}",
        f"objective_is = {json.dumps(OBJECTIVE)}",
        *([] if first.refused else [f"objective_before = {first.objective:.3f}"]),
        f"objective = {best.objective:.3f}",
        *(f"{name} = {value:.3f}" for name, value in best.scores.items()),
        f"at_an_end = {json.dumps(sorted(ends_near(best.options, space)))}",
        f"searched = {_inline(searched)}",
        *("recordings = [", *(f"  {_inline(entry)}," for entry in recordings), "]"),
        *("trials = [", *(f"  {_inline(entry)}," for entry in told), "]"),
        "",
        f"[{tracker}.{options}]",
        *_assignments(best.options),
    ]
    write_text(path, "\n".join(lines) + "\n")


def _assignments(table: Mapping[str, object]) -> list[str]:
    return [f"{name} = {json.dumps(value)}" for name, value in table.items()]


def _inline(entry: Mapping[str, object]) -> str:
    return "{ " + ", ".join(_assignments(entry)) + " }"


def _other_tables(path: Path, replaced: str) -> list[str]:
    kept, keep = [], True
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        if line.startswith("["):
            keep = line.strip("[]").partition(".")[0] != replaced
        if keep:
            kept.append(line)
    return [*kept, ""] if kept and kept[-1] else kept
