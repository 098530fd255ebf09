"""Metrics of long runs: each part is measured once and freed, and the totals are made from the measures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from harness.scoring.evidence.settings import ScoringSettings
from harness.scoring.gathered import Evidence

Part = TypeVar("Part")


@dataclass(frozen=True)
class Basis:
    """What a total rests on beside its parts: the numbers of the rules and the seed of the run."""

    settings: ScoringSettings
    seed: int

    def new_rng(self) -> np.random.Generator:
        """Return a generator of the run's seed: one for each metric, so that none moves another's draws."""
        return np.random.default_rng(self.seed)


@dataclass(frozen=True)
class InParts(Generic[Part]):
    """A metric that needs no more than one stretch of a run at a time; called with evidence it scores that alone.

    A stretch is one or more whole episodes, so that no vehicle and no track goes from one stretch to another.

    Attributes:
        measure: Returns what the total needs to know of a stretch: numbers, or arrays far smaller than its tables.
        total: Returns the metric's table of the measures in the order of the stretches.
    """

    measure: Callable[[Evidence], Part]
    total: Callable[[Sequence[Part], Basis], Mapping[str, object]]

    def __call__(self, evidence: Evidence) -> Mapping[str, object]:
        """Score evidence that is a whole run."""
        return self.total([self.measure(evidence)], Basis(evidence.settings, evidence.seed))


def joined(arrays: Sequence[np.ndarray[Any, np.dtype[Any]]], axis: int = 0) -> np.ndarray[Any, np.dtype[Any]]:
    """Return arrays as one; a single one is not copied."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays, axis=axis)


def ratio(part: float, whole: float) -> float:
    """Return a part of a whole as a share of it, nan of none."""
    return float(part) / float(whole) if whole else np.nan
