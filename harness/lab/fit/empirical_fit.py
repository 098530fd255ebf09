"""Fills the table of the empirical follower from recorded drivers."""

from __future__ import annotations

import numpy as np

from harness.lab.fit.driver_fit import situation_columns
from harness.lab.windows.car_following import CarFollowing
from mmpf.motion.learned.empirical import EmpiricalFollower
from mmpf.motion.learned.features import situation
from mmpf.numerics.arrays import FloatArray, IntArray

CELLS = (8, 6, 7, 7)
"""Along log gap, speed, closing speed and acceleration; each holds equally many moments of its axis."""
QUANTILES = 9
FEWEST = 30


def fit_empirical(led: CarFollowing) -> EmpiricalFollower:
    """Count the changes of acceleration until the next step of all windows, which must have leaders.

    A cell with fewer than 30 moments takes those of its gap, speed and acceleration whatever the closing speed, then
    those of its acceleration, so that no cell is empty where drivers have been.
    """
    now = slice(None, -1)
    seen = situation(*(column[:, now].ravel() for column in situation_columns(led))).T
    change = np.diff(led.accel_mps2, axis=1).ravel()
    axes = (seen[0], seen[1], seen[3], seen[2])
    inner = [np.linspace(0.0, 1.0, count + 1)[1:-1] for count in CELLS]
    edges = tuple(np.unique(np.quantile(axis, shares)) for axis, shares in zip(axes, inner, strict=True))
    shape = tuple(len(along) + 1 for along in edges)
    empty = EmpiricalFollower(edges, np.zeros((*shape, QUANTILES)))
    cell = empty.cells(seen)
    filled, counts = _quantiles(change, cell, int(np.prod(shape)))
    place = np.array(np.unravel_index(np.arange(len(filled)), shape))
    for kept in ((0, 1, 3), (3,)):
        coarse = np.ravel_multi_index(tuple(place[axis] for axis in kept), tuple(shape[axis] for axis in kept))
        instead, enough = _quantiles(change, coarse[cell], int(coarse.max()) + 1)
        short = (counts < FEWEST) & (enough[coarse] >= FEWEST)
        filled[short], counts[short] = instead[coarse[short]], enough[coarse[short]]
    return EmpiricalFollower(edges, filled.reshape(*shape, QUANTILES))


def _quantiles(values: FloatArray, cell: IntArray, cells: int) -> tuple[FloatArray, IntArray]:
    """Return the quantiles of the values in each cell, shape (cells, quantiles), and how many there are."""
    order = np.lexsort((values, cell))
    values, counts = values[order], np.bincount(cell, minlength=cells)
    first = np.cumsum(counts) - counts
    levels = first[:, None] + np.linspace(0.0, 1.0, QUANTILES) * np.maximum(counts - 1, 0)[:, None]
    return values[np.minimum(np.round(levels).astype(np.int64), len(values) - 1)], counts
