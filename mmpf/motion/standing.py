"""Standing vehicles stay in place: nonnegative speed noise alone would let them creep forward."""

from __future__ import annotations

import numpy as np

from mmpf.motion.state import ACCEL, LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import BoolArray, FloatArray

# Who is slower than this stands, and goes on standing until it starts.
STANDS_MPS = 0.3
STARTS_PER_S = 0.5
# What stands drifts as the ego's own place does, by which detections are put into the plane: m per root second.
DRIFT_STD = 0.1


def drawn_standing(speed_mps: FloatArray, dt_s: float, rng: np.random.Generator) -> BoolArray:
    """Draw which vehicles stand and do so throughout a step, shape (n,)."""
    return np.asarray((speed_mps < STANDS_MPS) & (rng.random(len(speed_mps)) < np.exp(-STARTS_PER_S * dt_s)))


def hold_still(moved: FloatArray, before: FloatArray, stands: BoolArray) -> None:
    """Put states of those who stand back to where they were, without speed; ``moved``, shape (6, n), is changed.

    Who starts has the speed from which nobody counts as standing any more: a step's gain of speed alone is less.
    """
    starts = (before[SPEED] < STANDS_MPS) & ~stands & (moved[SPEED] > before[SPEED])
    moved[SPEED] = np.where(starts, np.maximum(moved[SPEED], STANDS_MPS), moved[SPEED])
    for row in (LON, LAT):
        moved[row] = np.where(stands, before[row], moved[row])
    for row in (SPEED, LAT_SPEED, ACCEL):
        moved[row] = np.where(stands, 0.0, moved[row])


def drift_in_plane(moved: FloatArray, stands: BoolArray, std_m: float, rng: np.random.Generator) -> None:
    """Let those who stand drift a little in the plane, in place. A particle that never moves can't follow a vehicle."""
    index = np.flatnonzero(stands)
    lon_m, lat_m = std_m * rng.standard_normal((2, len(index)))
    moved[LON, index] += lon_m
    moved[LAT, index] += lat_m
