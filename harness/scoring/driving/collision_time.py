"""Time to collision, used by several scores."""

import numpy as np

from mmpf.numerics.arrays import FloatArray


def time_to_collision(gap_m: FloatArray, speed_mps: FloatArray, leader_mps: FloatArray) -> FloatArray:
    """Return the gap over the speed of closing in (Hayward 1972); infinite where the gap does not close, (n,)."""
    closing = speed_mps - leader_mps
    nears = np.isfinite(gap_m) & (closing > 0.0)
    return np.asarray(np.divide(np.maximum(gap_m, 0.0), closing, out=np.full(len(gap_m), np.inf), where=nears))
