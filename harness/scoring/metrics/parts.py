"""Metrics of long runs: each part is measured once and freed, and the totals are made from the measures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import wraps
from typing import Any, Generic, TypeVar

import numpy as np

from harness.common.bootstrap import cluster_bootstrap
from harness.scoring.gathered import Evidence
from mmpf.numerics.arrays import BoolArray, FloatArray

Part = TypeVar("Part")


ROWS = {"rows": True}
"""Metadata of a part's field whose arrays or lists stand one after the other in the whole, instead of added up."""


@dataclass(frozen=True)
class InParts(Generic[Part]):
    """A metric that needs no more than one stretch of a run at a time.

    A stretch is one or more whole episodes, so that no vehicle and no track goes from one stretch to another.

    Attributes:
        measure: Returns what the total needs to know of a stretch: numbers, or arrays far smaller than its tables.
        total: Returns the metric's table of the measures in the order of the stretches. Its generator begins with the
            run's seed for each metric, so that none moves another's draws.
    """

    measure: Callable[[Evidence], Part]
    total: Callable[[Sequence[Part], np.random.Generator], Mapping[str, object]]


def of_whole(
    total: Callable[[Part], Mapping[str, object]],
) -> Callable[[Sequence[Part | None], np.random.Generator], Mapping[str, object]]:
    """Return the total of parts, made of all of them as one; without any but None it has no meaning, and is empty."""

    @wraps(total)
    def of_part(part: Part, _: np.random.Generator) -> Mapping[str, object]:
        return total(part)

    return drawn_of_whole(of_part)


def drawn_of_whole(
    total: Callable[[Part, np.random.Generator], Mapping[str, object]],
) -> Callable[[Sequence[Part | None], np.random.Generator], Mapping[str, object]]:
    """Return the same of a total that draws, as intervals do."""

    @wraps(total)
    def of_parts(parts: Sequence[Part | None], rng: np.random.Generator) -> Mapping[str, object]:
        known = [part for part in parts if part is not None]
        return total(combined(known), rng) if known else {}

    return of_parts


def combined(parts: Sequence[Any]) -> Any:  # noqa: ANN401
    """Return parts as one: numbers, arrays and all inside tuples and dataclasses added up, but for ``ROWS``."""
    first = parts[0]
    if len(parts) == 1:
        return first
    if is_dataclass(first) and not isinstance(first, type):
        together: dict[str, Any] = {}
        for each in fields(first):
            values = [getattr(part, each.name) for part in parts]
            row = [item for value in values for item in value] if isinstance(values[0], list) else None
            alone = each.metadata.get("rows")
            together[each.name] = combined(values) if not alone else joined(values) if row is None else row
        return replace(first, **together)
    if isinstance(first, tuple):
        return tuple(combined(values) for values in zip(*parts, strict=True))
    return np.sum(parts, axis=0) if isinstance(first, np.ndarray) else sum(parts)


def joined(arrays: Sequence[np.ndarray[Any, np.dtype[Any]]], axis: int = 0) -> np.ndarray[Any, np.dtype[Any]]:
    """Return arrays as one; a single one is not copied."""
    return arrays[0] if len(arrays) == 1 else np.concatenate(arrays, axis=axis)


def of_any(statistic: Callable[[Any], Any], values: FloatArray | BoolArray) -> float:
    """Return a statistic of values, such as ``np.mean``; nan of none."""
    return float(statistic(values)) if len(values) else np.nan


def ratio(part: float, whole: float) -> float:
    """Return a part of a whole as a share of it, nan of none."""
    return float(part) / float(whole) if whole else np.nan


def intervals_of(
    names: Sequence[str], sums: FloatArray, counts: FloatArray, rng: np.random.Generator
) -> dict[str, list[float] | None]:
    """Return the intervals of ``cluster_bootstrap`` under each mean's name with ``_ci95``; None for too few groups."""
    found = zip(names, cluster_bootstrap(sums, counts, rng), strict=True)
    return {f"{name}_ci95": None if np.isnan(ends.low) else [ends.low, ends.high] for name, ends in found}
