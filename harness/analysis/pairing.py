"""Which runs of two grids belong together, and what of them is independent."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from harness.analysis.arms import Layout
from harness.storage.schema import RECORDING
from mmpf.numerics.arrays import IntArray

FEWEST_COMMON = 0.5
"""Share of a's runs in the common settings that b needs to have too; with less, something is amiss with b."""


@dataclass(frozen=True)
class Pairing:
    """Which rows of two tables of runs are compared.

    Attributes:
        of_a: Rows of the first, shape (n,).
        of_b: Rows of the second, in the same order where paired, shape (m,).
        layout: What they belong to.
        units: What the independent units are, in the plural.
        lacking: What b lacks of a's runs, in a sentence; empty where it is little.
    """

    of_a: IntArray
    of_b: IntArray
    layout: Layout
    units: str
    lacking: str


def pair(a: pd.DataFrame, b: pd.DataFrame, settings: list[str]) -> Pairing:
    """Pair runs by setting and seed; without common ones, take all runs of common settings.

    Independent are recordings, else seeds; of a single seed at several densities, its runs.

    Args:
        a: Runs of one tracker in the first arm.
        b: Likewise in the second.
        settings: Columns that tell one setting from another.
    """
    recorded = [RECORDING] if RECORDING in a and RECORDING in b else []
    world_a, world_b = _numbered(a, b, [*settings, *recorded])
    keys_a = {key: place for place, key in enumerate(zip(world_a.tolist(), a["seed"], strict=True))}
    keys_b = {key: place for place, key in enumerate(zip(world_b.tolist(), b["seed"], strict=True))}
    common = [key for key in keys_a if key in keys_b]
    due = int(np.isin(world_a, world_b).sum())
    if common:
        of_a, of_b = (np.array([keys[key] for key in common], dtype=np.int64) for keys in (keys_a, keys_b))
    else:
        of_a, of_b = (np.flatnonzero(np.isin(*pair)) for pair in ((world_a, world_b), (world_b, world_a)))
    few = bool(common) and len(common) < FEWEST_COMMON * due
    first, second = a.iloc[of_a], b.iloc[of_b]
    units = _numbered(first, second, recorded or ["seed"])
    strata = _numbered(first, second, settings)
    if common and len(common) > 1 and len(np.unique(units[0])) < 2:
        every, one = np.arange(len(common)), np.zeros(len(common), dtype=np.int64)
        units, strata = (every, every), (one, one)
    return Pairing(
        of_a=of_a,
        of_b=of_b,
        layout=Layout(bool(common), strata, units),
        units="recordings" if recorded else "seeds",
        lacking=f"b has only {len(common)} of the {due} runs of a." if few else "",
    )


def _numbered(a: pd.DataFrame, b: pd.DataFrame, columns: list[str]) -> tuple[IntArray, IntArray]:
    """Number the distinct rows of some columns of two tables, shapes (rows of a,) and (rows of b,)."""
    both = pd.concat([a[columns], b[columns]], ignore_index=True).astype(object)
    if not len(both):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    number = both.where(both.notna(), "").apply(tuple, axis=1).factorize()[0].astype(np.int64)
    return number[: len(a)], number[len(a) :]
