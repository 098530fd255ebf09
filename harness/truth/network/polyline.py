"""Lines of points in the plane, shape (p, 2), and operations that all lane-graph readers share."""

from collections.abc import Callable, Iterable, Mapping

import numpy as np

from harness.common.bounds import PLACE_M, Numbers
from mmpf.numerics.arrays import FloatArray

BACK, LONG_PIECE_M = -0.97, 10.0


def length_of(line: FloatArray) -> float:
    """Return a line's length."""
    return float(np.hypot(*np.diff(line, axis=0).T).sum())


def checked_line(line: FloatArray, longest_m: float, what: str) -> FloatArray:
    """Return a line that is one.

    Raises:
        ValueError: It has fewer than two points, no length or too much of it, or lies too far away.
    """
    if len(line) < 2:
        raise ValueError(f"{what} needs two points or more")
    PLACE_M.check(f"a point of {what}", line)
    Numbers(1e-9, longest_m).check(f"the length of {what}", length_of(line))
    if doubles_back(line):
        raise ValueError(f"{what} doubles back")
    return line


def doubles_back(line: FloatArray) -> bool:
    """Return whether a line turns back nearly on itself between two long pieces, as no edge of a lane does."""
    steps = np.diff(line[:, :2], axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    along = (steps[1:] * steps[:-1]).sum(axis=1) / np.maximum(lengths[1:] * lengths[:-1], 1e-9)
    return bool(((along < BACK) & (np.minimum(lengths[1:], lengths[:-1]) > LONG_PIECE_M)).any())


def at_shares(line: FloatArray, shares: FloatArray) -> FloatArray:
    """Return the places at shares of a line's length, shape (k, 2)."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    along /= max(along[-1], 1e-9)
    return np.column_stack([np.interp(shares, along, line[:, 0]), np.interp(shares, along, line[:, 1])])


def beside(line: FloatArray, other: FloatArray, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how far another line lies from one, and to the left of it, at shares of their lengths, each (k,)."""
    ahead = at_shares(line, shares + 1e-3) - at_shares(line, shares - 1e-3)
    away = at_shares(other, shares) - at_shares(line, shares)
    left = (ahead[:, 0] * away[:, 1] - ahead[:, 1] * away[:, 0]) / np.maximum(np.hypot(*ahead.T), 1e-9)
    return np.hypot(*away.T), left


def grid_origin(low_xy: FloatArray) -> FloatArray:
    """Return the whole kilometres below a place, from where places are counted, shape (2,), metres."""
    # Adding zero turns -0.0 into 0.0.
    return np.asarray(np.floor(low_xy / 1000.0) * 1000.0 + 0.0)


def followers(name: str, index: Mapping[str, int], after: Callable[[str], Iterable[str]]) -> list[int]:
    """Return the lanes that follow one; those that are not in the graph, since they are too short, are linked past."""
    found: dict[int, None] = {}
    met, waiting = {name}, [name]
    while waiting:
        for following in after(waiting.pop()):
            if following in index:
                found[index[following]] = None
            elif following not in met:
                met.add(following)
                waiting.append(following)
    return list(found)
