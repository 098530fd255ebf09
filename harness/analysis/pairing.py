"""Pairs the runs of two grids, and says which pairs are independent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from harness.analysis.arms import Layout
from harness.storage.schema import RECORDING
from mmpf.numerics.arrays import IntArray

MOST_LISTED = 4
"""Settings with missing runs that are listed."""


@dataclass(frozen=True)
class Pairing:
    """Which rows of two tables of runs are compared.

    Attributes:
        of_a: Rows of the first, shape (n,).
        of_b: Rows of the second, in the same order where paired, shape (m,).
        layout: What they belong to.
        units: What the independent units are, in the plural.
        lacking: What each side lacks of the other's runs, a sentence each.
    """

    of_a: IntArray
    of_b: IntArray
    layout: Layout
    units: str
    lacking: tuple[str, ...]


def pair(a: pd.DataFrame, b: pd.DataFrame, settings: list[str]) -> Pairing:
    """Pair runs of one tracker by setting and seed; without common ones, take all runs of common settings.

    Independent are recordings, else seeds; of a single seed at several densities, its runs.
    """
    recorded = [RECORDING] if RECORDING in a and RECORDING in b else []
    world_a, world_b = _numbered(a, b, [*settings, *recorded])
    keys_a = {key: place for place, key in enumerate(zip(world_a.tolist(), a["seed"], strict=True))}
    keys_b = {key: place for place, key in enumerate(zip(world_b.tolist(), b["seed"], strict=True))}
    common = [key for key in keys_a if key in keys_b]
    if common:
        of_a, of_b = (np.array([keys[key] for key in common], dtype=np.int64) for keys in (keys_a, keys_b))
    else:
        of_a, of_b = (np.flatnonzero(np.isin(*pair)) for pair in ((world_a, world_b), (world_b, world_a)))
    first, second = a.iloc[of_a], b.iloc[of_b]
    units = _numbered(first, second, recorded or ["seed"])
    strata = _numbered(first, second, settings)
    if common and len(common) > 1 and len(np.unique(units[0])) < 2:
        every, one = np.arange(len(common)), np.zeros(len(common), dtype=np.int64)
        units, strata = (every, every), (one, one)
    lacking = (
        _lacking("b", "a", a, sorted(set(range(len(a))) - set(of_a)), [*settings, *recorded], bool(common)),
        _lacking("a", "b", b, sorted(set(range(len(b))) - set(of_b)), [*settings, *recorded], bool(common)),
    )
    return Pairing(
        of_a=of_a,
        of_b=of_b,
        layout=Layout(bool(common), strata, units),
        units="recordings" if recorded else "seeds",
        lacking=tuple(filter(None, lacking)),
    )


def _lacking(side: str, other: str, runs: pd.DataFrame, places: list[int], settings: list[str], paired: bool) -> str:
    """Return which of the other side's runs a side lacks, by setting; empty where none."""
    if not places:
        return ""
    told = []
    for _, rows in runs.iloc[places].groupby(settings, dropna=False, sort=False):
        values = rows[settings].iloc[0].dropna()
        where = ", ".join(
            f"{key} {value:g}" if isinstance(value, float) else str(value) for key, value in values.items()
        )
        told.append(f"{where}: {_spans(rows['seed'].tolist())}" if paired else where)
    more = f"; and {len(told) - MOST_LISTED} more settings" if len(told) > MOST_LISTED else ""
    return f"{side} lacks {len(places)} of the {len(runs)} runs of {other} ({'; '.join(told[:MOST_LISTED])}{more})."


def _spans(seeds: list[int]) -> str:
    """Return seeds as text, with consecutive ones as first to last."""
    spans: list[list[int]] = []
    for seed in sorted(seeds):
        if spans and seed == spans[-1][1] + 1:
            spans[-1][1] = seed
        else:
            spans.append([seed, seed])
    words = ", ".join(f"{first} to {last}" if last > first else str(first) for first, last in spans)
    return f"seed{'s' if len(seeds) > 1 else ''} {words}"


def _numbered(a: pd.DataFrame, b: pd.DataFrame, columns: list[str]) -> tuple[IntArray, IntArray]:
    """Number the distinct rows of some columns of two tables, shapes (rows of a,) and (rows of b,)."""
    both = pd.concat([a[columns], b[columns]], ignore_index=True).astype(object)
    if not len(both):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    number = both.where(both.notna(), "").apply(tuple, axis=1).factorize()[0].astype(np.int64)
    return number[: len(a)], number[len(a) :]
