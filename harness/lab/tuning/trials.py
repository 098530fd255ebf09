"""The search for a tracker's settings: Optuna's tree-structured Parzen estimator with successive halving.

A trial keeps most of the best setting's values, and Optuna chooses the others: with a dozen or more values to choose
and a budget of some dozens of trials, choosing all of them anew finds less. Each setting is tried on the recordings
batch by batch; one that is behind half of those tried so far is stopped. One that fails a conformance check is refused
before any recording is followed. Half way and at three quarters of the trials, ranges at whose end the best setting
lies are widened.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from harness.common.errors import InputError
from harness.lab.tuning.spaces import Choices, End, Options, Range, is_searched, short

HIDDEN_COST_PER_M = 5.0
"""Points of the objective for a metre of hidden cost."""
FALSE_HIDDEN_COST = 2.0
"""Points of the objective for a false hidden track a scan: else a tracker that keeps everything would be the best."""
WITHHELD_COST = 1.0
"""Points of the objective for each percent of the vehicle-steps in plain view that have no track."""
STOPPED_COST = 0.5
"""Points for each percent of those of stopped vehicles: ten percent cost what doubting all that stands may gain."""
OBJECTIVE = (
    f"(hota + idf1) / 2 - {HIDDEN_COST_PER_M:g} hidden_cost_m - {FALSE_HIDDEN_COST:g} false_hidden_tracks_per_scan - "
    f"{WITHHELD_COST:g} (100 - plain_view_recall) - {STOPPED_COST:g} (100 - stopped_recall), each where it is measured"
)
_WIDENED_AFTER = (0.5, 0.75)
_KEPT = 0.75


@dataclass(frozen=True)
class Scores:
    """How well a setting did; what is not measured is nan.

    Attributes:
        hota: HOTA in sight, percent.
        idf1: IDF1 in sight, percent.
        hidden_cost_m: Mean of the error, at most 10 m, over all vehicle-steps hidden after having been tracked.
        false_hidden_tracks_per_scan: False hidden tracks a scan.
        plain_view_recall: Share of the vehicle-steps in plain view that have a track, percent.
        stopped_recall: The same of vehicles stopped amid traffic, percent.
    """

    hota: float
    idf1: float
    hidden_cost_m: float = math.nan
    false_hidden_tracks_per_scan: float = math.nan
    plain_view_recall: float = math.nan
    stopped_recall: float = math.nan

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names of the scores."""
        return tuple(column.name for column in fields(cls))

    @classmethod
    def of(cls, metrics: Mapping[str, Any]) -> Scores:
        """Take the scores out of a run's metrics."""
        in_sight, hidden, in_view = (metrics.get(name, {}) for name in ("mot", "hidden", "in_plain_view"))
        return cls(
            _number(in_sight["hota"]),
            _number(in_sight["idf1"]),
            _number(hidden.get("hidden_cost_m")),
            _number(hidden.get("false_hidden_tracks_per_scan")),
            _number(in_view.get("recall")),
            _number(in_view.get("stopped_recall")),
        )

    @classmethod
    def mean(cls, several: Sequence[Scores]) -> Scores:
        """Return the means over recordings; a score that a recording has none of is left out of its mean."""
        return cls(**{name: _mean([getattr(each, name) for each in several]) for name in cls.names()})

    @property
    def objective(self) -> float:
        """What the search maximises, see ``OBJECTIVE``."""
        costs = (
            HIDDEN_COST_PER_M * self.hidden_cost_m,
            FALSE_HIDDEN_COST * self.false_hidden_tracks_per_scan,
            WITHHELD_COST * (100.0 - self.plain_view_recall),
            STOPPED_COST * (100.0 - self.stopped_recall),
        )
        return 0.5 * (self.hota + self.idf1) - sum(cost for cost in costs if math.isfinite(cost))


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


def _mean(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.mean(known)) if known else math.nan


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
    scores: Scores
    batches: int = 1
    stopped: bool = False
    refused: str = ""

    @property
    def objective(self) -> float:
        """What the search maximises."""
        return self.scores.objective

    @property
    def counts(self) -> bool:
        """Whether it may be the best: it was neither stopped nor refused."""
        return not (self.stopped or self.refused)


@dataclass(frozen=True)
class Found:
    """What a search has come to.

    Attributes:
        trials: All trials in the order they were made, the defaults first.
        space: What was searched, with the ranges as they were widened.
    """

    trials: Sequence[Trial]
    space: Mapping[str, Range | Choices]

    @property
    def best(self) -> Trial:
        """The best trial that counts, the earliest of equals.

        Raises:
            InputError: None counts.
        """
        counting = [trial for trial in self.trials if trial.counts]
        if not counting:
            raise InputError(f"every setting was refused, the first one for {self.trials[0].refused}; mend the tracker")
        return max(counting, key=lambda trial: trial.objective)

    @property
    def at_an_end(self) -> dict[str, End]:
        """Which of the best settings lie at an end of their range, and at which."""
        return ends_near(self.best.options, self.space)


def ends_near(options: Options, space: Mapping[str, Range | Choices]) -> dict[str, End]:
    """Return which settings lie at an end of their range, and at which."""
    near = {}
    for key, value in options.items():
        values = space[key]
        end = values.end_near(value) if isinstance(values, Range) and isinstance(value, int | float) else None
        if end is not None:
            near[key] = end
    return near


Follow = Callable[[Options, int], Sequence[Scores]]
Refusal = Callable[[Options], str]


def search(
    starts: Sequence[Options],
    space: Mapping[str, Range | Choices],
    follow: Follow,
    batches: int,
    budget: int,
    tell: Callable[[Trial], object],
    refusal: Refusal = lambda _: "",
) -> Found:
    """Search for the best setting.

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
    study, space, rng = _study(), dict(space), np.random.default_rng(0)
    trials: list[Trial] = []
    while len(trials) < budget:
        if any(trial.counts for trial in trials) and len(trials) in {round(share * budget) for share in _WIDENED_AFTER}:
            space = _widened(space, Found(trials, space).at_an_end)
        if len(trials) < len(starts):
            kept, like = set(space), starts[len(trials)]
        else:
            kept, like = _kept(list(space), rng), Found(trials, space).best.options
        study.enqueue_trial({key: value for key, value in like.items() if key in kept and value in space[key]})
        asked = study.ask()
        options = _suggested(asked, space, kept, like)
        reason = refusal(options)
        if reason:
            trials.append(Trial(options, Scores(math.nan, math.nan), 0, refused=reason))
        else:
            trials.append(_tried(options, follow, batches, asked))
        if trials[-1].counts:
            study.tell(asked, trials[-1].objective)
        else:
            study.tell(asked, state=_optuna().trial.TrialState.PRUNED)
        tell(trials[-1])
    return Found(trials, space)


def _kept(keys: Sequence[str], rng: np.random.Generator) -> set[str]:
    """Return which settings stay as they are: most of them, and never all."""
    changed = keys[int(rng.integers(len(keys)))]
    return {key for key in keys if rng.random() < _KEPT and key != changed}


def _widened(space: Mapping[str, Range | Choices], at_an_end: Mapping[str, End]) -> dict[str, Range | Choices]:
    """Return what is searched with some ranges widened at an end."""
    wider = dict(space)
    for key, end in at_an_end.items():
        values = space[key]
        wider[key] = values.widened(end) if isinstance(values, Range) else values
    return wider


def check_installed() -> None:
    """Refuse to begin without Optuna.

    Raises:
        InputError: It is not installed.
    """
    _optuna()


def _optuna() -> Any:  # noqa: ANN401
    try:
        import optuna  # noqa: PLC0415
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] != "optuna":
            raise
        raise InputError("tuning needs Optuna, which is not installed: pip install '.[tuning]'") from None
    return optuna


def _study() -> Any:  # noqa: ANN401
    optuna = _optuna()
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    # Parameters are drawn one by one, so that a range may be widened in between.
    sampler = optuna.samplers.TPESampler(seed=0, multivariate=False)
    pruner = optuna.pruners.SuccessiveHalvingPruner(min_resource=1, reduction_factor=2)
    return optuna.create_study(direction="maximize", sampler=sampler, pruner=pruner)


def _tried(options: Options, follow: Follow, batches: int, asked: Any) -> Trial:  # noqa: ANN401
    """Return how well a setting did; it is stopped when Optuna says so."""
    done: list[Scores] = []
    for batch in range(1, batches + 1):
        done += follow(options, batch - 1)
        trial = Trial(options, Scores.mean(done), batch)
        if batch < batches:
            asked.report(trial.objective, batch)
            if asked.should_prune():
                return replace(trial, stopped=True)
    return trial


def _suggested(
    asked: Any,  # noqa: ANN401
    space: Mapping[str, Range | Choices],
    kept: Collection[str],
    like: Options,
) -> Options:
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
        if key in kept and key in like and like[key] not in values:
            options[key] = like[key]
        elif not isinstance(values, Range):
            options[key] = asked.suggest_categorical(key, values)
        elif values.whole:
            options[key] = asked.suggest_int(key, int(values.low), int(values.high))
        else:
            options[key] = short(asked.suggest_float(key, values.low, values.high, log=values.log))
    return options
