"""What a metric states about each of its numbers: name, unit and direction."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from harness.common.intervals import Possible
from mmpf.numerics.arrays import FloatArray

Columns = Callable[[str], FloatArray]
"""Returns the values of a key in all runs, nan where a run has none, shape (runs,)."""

OF_SOME_RUNS = frozenset(
    {
        *("manoeuvre", "hidden_by", "unseen_turns", "gaps", "pseudo_occlusion", "decisions", "never_seen"),
        *("in_plain_view", "existence_calibration", "calibration", "motion"),
    }
)
"""Metrics that need a map, real detections, a driver or expectations, and those that older runs lack."""

STEPS = "timing.steps"
"""Key of a run's number of scans."""
MOST = {"%": 100.0, "percentage points": 100.0, "°": 180.0, "Brier score": 1.0}
"""The largest value of a quantity whose label ends so; a heading error is 180 degrees at most."""


@dataclass(frozen=True)
class Quantity:
    """A number of ``metrics.json`` as tables show it, unless a table names, rounds or weighs it in its own way.

    Attributes:
        key: Its keys in ``metrics.json``, joined by dots.
        label: Its name with its unit, for people; ``heading`` is short enough for a column.
        decimals: How many are shown; verdicts show one more.
        weight: Key of the samples behind it, by which runs are averaged; empty where every run counts the same.
        scale: Given where the number is a count: what count over ``weight`` is multiplied by, 100 for percent.
        is_counted: Whether it is a rate of events, which are counted over ``weight``.
        least: The least value that it can have; minus infinity of one with a sign.
        limit: The largest value that it can have, where its label's unit does not tell.
        is_root: Whether it is a root mean square, so that runs are averaged by their squares.
        best: The best value, where that lies between others: nothing is judged by it then.
        pooled: Returns sums and weights of runs, both of shape (runs,), of which the ratio is the value of all runs
            together; None for the mean by ``weight``.
    """

    key: str
    label: str
    higher_is_better: bool = False
    decimals: int = 1
    heading: str = ""
    weight: str = ""
    scale: float | None = None
    least: float = 0.0
    is_counted: bool = False
    limit: float = math.inf
    is_root: bool = False
    best: float | None = None
    pooled: Callable[[Columns], tuple[FloatArray, FloatArray]] | None = None

    def of(self, metrics: Mapping[str, Any]) -> float | None:
        """Return its value in the content of a ``metrics.json``; None where there is none."""
        value: Any = metrics
        for part in self.key.split("."):
            value = value.get(part) if isinstance(value, Mapping) else None
        return None if value is None else float(value)

    @property
    def most(self) -> float:
        """The largest value that it can have."""
        return next((most for unit, most in MOST.items() if self.label.endswith(unit)), self.limit)

    @property
    def better(self) -> str:
        """Which values are better, in a word or two."""
        return ("higher" if self.higher_is_better else "lower") if self.best is None else f"near {self.best:g}"

    @property
    def possible(self) -> Possible:
        """Which values its mean can have."""
        events = 1.0 / (self.scale or 1.0) if self.is_counted else 0.0
        return Possible(self.least, self.most, events, is_share=math.isinf(self.limit))

    @property
    def metric(self) -> str:
        """Key of its metric."""
        return self.key.partition(".")[0]

    @property
    def is_of_some_runs(self) -> bool:
        """Whether tables in which nothing has a value leave it out."""
        return self.metric in OF_SOME_RUNS


def of_kinds(name: str, kinds: Mapping[str, str], *scores: Quantity) -> tuple[Quantity, ...]:
    """Return each score of each kind: both go before its key and weight, the kind's words into its label."""
    places = ((f"{name}.{kind}.", words, score) for kind, words in kinds.items() for score in scores)
    return tuple(
        replace(score, key=place + score.key, label=score.label.format(words), weight=place + score.weight)
        for place, words, score in places
    )
