"""Uncertainty of means: bootstrap over vehicles within a run or over seeds, and paired comparisons."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

MOST_WEIGHTS = 2_000_000
TAIL = 0.5 * (1.0 - 0.95)
"""Share of resampled means beyond either end of an interval."""


@dataclass(frozen=True)
class Interval:
    """A confidence interval; nan where there is nothing to estimate it from."""

    low: float
    high: float


def group_sums(values: FloatArray, group: IntArray) -> tuple[FloatArray, FloatArray]:
    """Sum the columns of values, shape (n, k), over groups numbered from 0, shape (n,); nan is left out.

    Returns:
        Sums and numbers of finite values, both of shape (groups, k).
    """
    finite = np.isfinite(values)

    def summed(table: npt.NDArray[Any]) -> FloatArray:
        return np.stack([np.bincount(group, column) for column in table.T], axis=1, dtype=np.float64)

    return summed(np.where(finite, values, 0.0)), summed(finite)


def cluster_bootstrap(
    sums: FloatArray, counts: FloatArray, rng: np.random.Generator, draws: int = 1000
) -> list[Interval]:
    """Return the 95 % bootstrap intervals of several means that share their groups, which are resampled whole.

    Errors of one vehicle at successive steps are alike, so single rows must not be resampled as if independent (Efron &
    Tibshirani 1993, ch. 13). Sums and numbers of values are of shape (groups, quantities); bounds are nan where fewer
    than two groups have values.
    """
    groups = len(sums)
    if groups < 2:
        return [Interval(np.nan, np.nan)] * sums.shape[1]
    share = np.full(groups, 1.0 / groups)
    # The weights of all resamples at once would be larger than everything else that is known of a long run.
    at_once = max(1, MOST_WEIGHTS // groups)
    blocks = []
    for begin in range(0, draws, at_once):
        weights = rng.multinomial(groups, share, size=min(at_once, draws - begin)).astype(np.float64)
        total = weights @ counts
        blocks.append(np.divide(weights @ sums, total, out=np.full_like(total, np.nan), where=total > 0))
    ends = np.full((2, sums.shape[1]), np.nan)
    enough = np.count_nonzero(counts, axis=0) >= 2
    ends[:, enough] = np.nanquantile(np.concatenate(blocks)[:, enough], (TAIL, 1.0 - TAIL), axis=0)
    return [Interval(low, high) for low, high in ends.T.tolist()]
