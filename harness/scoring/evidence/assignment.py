"""Optimal one-to-one assignment over many small independent problems at once."""

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray


def best_assignment(left: IntArray, right: IntArray, score: FloatArray) -> BoolArray:
    """Choose pairs so that no left and no right item is used twice and the sum of scores is greatest.

    The pairs split into connected components, nearly all of which are a single pair; only the others need the
    Hungarian algorithm. Rows of different time steps never share a pair, so a whole run is solved by one call.

    Args:
        left: Left item of each pair, shape (p,), not negative. Pairs are distinct.
        right: Right item of each pair, shape (p,), not negative.
        score: Gain of each pair, shape (p,), positive.

    Returns:
        Which pairs are chosen, shape (p,).
    """
    alone = unrivalled(left, right)
    chosen = alone.copy()
    contested = np.flatnonzero(~alone)
    if len(contested):
        label = components(left[contested], right[contested])
        order = np.argsort(label, kind="stable")
        starts = np.flatnonzero(np.diff(label[order])) + 1
        for pairs in np.split(contested[order], starts):
            chosen[pairs] = solve_dense(left[pairs], right[pairs], score[pairs])
    return chosen


def unrivalled(left: IntArray, right: IntArray) -> BoolArray:
    """Return which pairs share neither their left nor their right item with another pair, shape (p,)."""
    if not len(left):
        return np.zeros(0, dtype=bool)
    return np.equal(np.bincount(left)[left], 1) & np.equal(np.bincount(right)[right], 1)


def components(left: IntArray, right: IntArray) -> IntArray:
    """Number the connected components of the pairs from 0, shape (p,)."""
    lefts, left_place = np.unique(left, return_inverse=True)
    rights, right_place = np.unique(right, return_inverse=True)
    nodes = len(lefts) + len(rights)
    graph = coo_array((np.ones(len(left), dtype=np.int8), (left_place, len(lefts) + right_place)), shape=(nodes, nodes))
    _, label = connected_components(graph, directed=False)
    return label[left_place].astype(np.int64)


def solve_dense(left: IntArray, right: IntArray, score: FloatArray) -> BoolArray:
    """Solve one small problem with the Hungarian algorithm; as ``best_assignment``."""
    _, row = np.unique(left, return_inverse=True)
    _, column = np.unique(right, return_inverse=True)
    gain = np.zeros((row.max() + 1, column.max() + 1))
    gain[row, column] = score
    rows, columns = linear_sum_assignment(gain, maximize=True)
    taken = np.zeros(gain.shape, dtype=bool)
    taken[rows, columns] = True
    return taken[row, column]
