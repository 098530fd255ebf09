"""Which components stand in one place."""

from __future__ import annotations

import numpy as np

from mmpf.cloud.mixture import Components
from mmpf.cloud.moments import Moments
from mmpf.compute.arrays import BoolArray
from mmpf.state import LAT, LON


def overlapping(components: Components, moments: Moments, share: float) -> BoolArray:
    """Return which components overlap which others, shape (m, m), symmetric; none overlaps itself.

    Args:
        components: The components, m of them, with their sizes.
        moments: Their moments.
        share: Two overlap whose means are nearer than this share of their mean length, and of their mean width.
    """
    mean, length, width = moments.mean, components.length_m, components.width_m
    overlaps = np.abs(mean[LON][:, None] - mean[LON]) < share * 0.5 * (length[:, None] + length)
    overlaps &= np.abs(mean[LAT][:, None] - mean[LAT]) < share * 0.5 * (width[:, None] + width)
    np.fill_diagonal(overlaps, val=False)
    return np.asarray(overlaps)
