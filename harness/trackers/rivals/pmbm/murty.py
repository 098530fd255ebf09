"""The k best assignments of detections to tracks, by Murty's partition (Operations Research 16, 1968)."""

import heapq
import itertools
import math
from collections.abc import Sequence

import numpy as np
from scipy.optimize import linear_sum_assignment

from mmpf.numerics.arrays import FloatArray, IntArray

NOBODY = -1
_FORBIDDEN = 1e9

Assignment = tuple[float, tuple[int, ...]]


def best_assignments(gain: FloatArray, count: int, worst_loss: float = math.inf) -> list[Assignment]:
    """Return the best assignments of detections to tracks, best first.

    Each detection goes to one track, and no two to the same, or to nobody, which is worth nothing.

    Args:
        gain: What each detection is worth to each track, minus infinity where it can't be its, shape (d, t).
        worst_loss: Assignments that are worth this much less than the best are left out.

    Returns:
        Of each assignment its worth and the track of each detection, or ``NOBODY``.
    """
    detections, tracks = gain.shape
    if detections == 1:
        return of_one(gain[0].tolist(), count, worst_loss)
    # Further columns stand for nobody, one for each detection.
    cost = np.full((detections, tracks + detections), _FORBIDDEN)
    cost[:, :tracks] = np.where(np.isfinite(gain), -gain, _FORBIDDEN)
    cost[np.arange(detections), tracks + np.arange(detections)] = 0.0
    columns, worth = _solved(cost, cost)
    order = itertools.count()
    waiting = [(-worth, next(order), columns, cost, 0)]
    found: list[Assignment] = []
    while waiting and len(found) < count:
        minus_worth, _, columns, under, fixed = heapq.heappop(waiting)
        if found and found[0][0] + minus_worth > worst_loss:
            break
        found.append((-minus_worth, tuple(int(c) if c < tracks else NOBODY for c in columns)))
        if len(found) == count:
            break
        for row in range(fixed, detections):
            # The rows before keep their columns, this one loses its own.
            other = under.copy()
            for kept in range(fixed, row):
                own = other[kept, columns[kept]]
                other[kept], other[:, columns[kept]] = _FORBIDDEN, _FORBIDDEN
                other[kept, columns[kept]] = own
            other[row, columns[row]] = _FORBIDDEN
            choice, worth = _solved(other, cost)
            if worth > -0.5 * _FORBIDDEN:
                heapq.heappush(waiting, (-worth, next(order), choice, other, row))
    return found


def of_one(gain: Sequence[float], count: int, worst_loss: float = math.inf) -> list[Assignment]:
    """Return the best choices for a single detection; as ``best_assignments``."""
    choices = [(worth, (track,)) for track, worth in enumerate(gain) if worth > -math.inf]
    choices.append((0.0, (NOBODY,)))
    choices.sort(key=lambda choice: -choice[0])
    return [choice for choice in choices[:count] if choice[0] >= choices[0][0] - worst_loss]


def _solved(allowed: FloatArray, cost: FloatArray) -> tuple[IntArray, float]:
    rows, columns = linear_sum_assignment(allowed)
    if (allowed[rows, columns] >= _FORBIDDEN).any():
        return columns, -_FORBIDDEN
    return columns, -float(cost[rows, columns].sum())
