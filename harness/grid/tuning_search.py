"""A search that moves one setting at a time up and down its ladder, for a given number of trials."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

Options = dict[str, object]

HIDDEN_COST_PER_M = 5.0
"""Points of the objective for a metre of hidden cost."""
FALSE_HIDDEN_COST = 2.0
"""Points of the objective for a false hidden track a scan: else a tracker that keeps everything would be the best."""
_REPEATS_UNTIL_MORE, _REPEATS_UNTIL_EXHAUSTED = 50, 1000


@dataclass(frozen=True)
class Scores:
    """How well a setting did; what is not measured is nan.

    Attributes:
        hota: HOTA in sight, percent.
        idf1: IDF1 in sight, percent.
        hidden_cost_m: Mean of the error, at most 10 m, over all vehicle-steps hidden after having been tracked.
        false_hidden_tracks_per_scan: False hidden tracks a scan.
    """

    hota: float
    idf1: float
    hidden_cost_m: float = math.nan
    false_hidden_tracks_per_scan: float = math.nan

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Return the names of the scores."""
        return tuple(column.name for column in fields(cls))

    @classmethod
    def of(cls, metrics: Mapping[str, Any]) -> Scores:
        """Take the scores out of a run's metrics."""
        in_sight = metrics["mot"]
        hidden = metrics.get("hidden", {})
        costs = {name: _number(hidden.get(name)) for name in ("hidden_cost_m", "false_hidden_tracks_per_scan")}
        return cls(_number(in_sight["hota"]), _number(in_sight["idf1"]), **costs)


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


@dataclass(frozen=True)
class Trial:
    """One setting and how well it did.

    Attributes:
        options: The tracker's options by dotted key.
        scores: Its scores, means over the recordings.
    """

    options: Options
    scores: Scores

    @property
    def objective(self) -> float:
        """What the search maximises: the mean of HOTA and IDF1 in sight, less what hiding costs, where it is known."""
        scores = self.scores
        costs = HIDDEN_COST_PER_M * scores.hidden_cost_m, FALSE_HIDDEN_COST * scores.false_hidden_tracks_per_scan
        return 0.5 * (scores.hota + scores.idf1) - sum(cost for cost in costs if math.isfinite(cost))


def best_of(trials: Sequence[Trial]) -> Trial:
    """Return the best trial, the earliest of equals."""
    return max(trials, key=lambda trial: trial.objective)


def search(
    start: Options, ladders: Mapping[str, Sequence[object]], score: Callable[[Options], Trial], budget: int
) -> list[Trial]:
    """Search for the best setting.

    Args:
        start: Where the search begins.
        ladders: The values of each setting, in order.
        score: Tries a setting.
        budget: Number of trials; fewer only if there are no more settings.

    Returns:
        All trials in the order they were made, none of them twice.
    """
    progress = _Search(ladders, score, budget, [score(start)], {_key(start)})
    made = 0
    while made < len(progress.trials) < budget:
        made = len(progress.trials)
        progress.climb(1)
        progress.climb(-1)
    progress.try_pairs()
    return progress.trials


@dataclass
class _Search:
    ladders: Mapping[str, Sequence[object]]
    score: Callable[[Options], Trial]
    budget: int
    trials: list[Trial]
    tried: set[str]

    def climb(self, step: int) -> None:
        """Move each setting along its ladder as long as that helps."""
        for option, ladder in self.ladders.items():
            while True:
                rung = ladder.index(best_of(self.trials).options[option]) + step
                if not 0 <= rung < len(ladder) or not self._helps({option: ladder[rung]}):
                    break

    def try_pairs(self) -> None:
        """Change two settings of the best at once, drawn at random, and more when those are exhausted."""
        rng = np.random.default_rng(0)
        names, repeats = list(self.ladders), 0
        while len(self.trials) < self.budget and repeats < _REPEATS_UNTIL_EXHAUSTED:
            made = len(self.trials)
            several = min(2 + repeats // _REPEATS_UNTIL_MORE, len(names))
            chosen = [names[k] for k in rng.choice(len(names), size=several, replace=False).tolist()]
            self._helps({name: self.ladders[name][int(rng.integers(len(self.ladders[name])))] for name in chosen})
            repeats = repeats + 1 if len(self.trials) == made else 0

    def _helps(self, change: Options) -> bool:
        best = best_of(self.trials)
        options = best.options | change
        if _key(options) in self.tried or len(self.trials) >= self.budget:
            return False
        self.tried.add(_key(options))
        self.trials.append(self.score(options))
        return self.trials[-1].objective > best.objective


def _key(options: Options) -> str:
    return json.dumps(options, sort_keys=True)
