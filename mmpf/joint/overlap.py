"""Which components overlap."""

from __future__ import annotations

import numpy as np

from mmpf.belief.mixture import Components
from mmpf.belief.moments import Moments
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import BoolArray, turned


def overlapping(components: Components, moments: Moments, share: float) -> BoolArray:
    """Return which components overlap, shape (m, m), symmetric, with a false diagonal.

    Args:
        components: The components, m of them, with their sizes.
        moments: Their moments.
        share: Two overlap whose means are nearer than this share of their mean length, and of their mean width.
    """
    mean, length, width = moments.mean, components.length_m, components.width_m
    along, across = turned(mean[LON][:, None] - mean[LON], mean[LAT][:, None] - mean[LAT], moments.heading_rad[:, None])
    overlaps = np.abs(along) < share * 0.5 * (length[:, None] + length)
    overlaps &= np.abs(across) < share * 0.5 * (width[:, None] + width)
    # Where directions differ, one sees the other beside it and not the other way round.
    overlaps |= overlaps.T
    np.fill_diagonal(overlaps, val=False)
    return np.asarray(overlaps)
