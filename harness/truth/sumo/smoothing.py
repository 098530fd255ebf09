"""Smooths SUMO's motion, because SUMO's drivers change acceleration and lateral drift within one step.

``hann_weights`` average over half a second to either side, ``CausalFilter`` knows the past alone.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from harness.truth.frame import STEP_S, Frame
from mmpf.numerics.arrays import FloatArray

LEAD_FRAMES = round(0.5 / STEP_S)
"""So many frames before the first and after the last smoothed one are needed."""
TIME_CONSTANT_S = 0.3
DECIMALS = 4
EXACT = ("lon_m", "lat_m", "speed_mps", "length_m", "width_m")


def hann_weights(reach: int) -> FloatArray:
    """Return the weights of a raised cosine over ``2 reach + 1`` samples, summing to one."""
    window = np.hanning(2 * reach + 3)[1:-1]
    return np.asarray(window / window.sum())


def rounded(values: FloatArray) -> FloatArray:
    """Return values rounded to 1e-4."""
    # Adding zero turns -0.0 into 0.0.
    return np.asarray(np.round(values, DECIMALS) + 0.0)


class CausalFilter:
    """A filter of first order over what SUMO changes from one step to the next, vehicle by vehicle.

    It is for a loop that acts on frames: ``hann_weights`` would give them half a second late.
    """

    def __init__(self, columns: Sequence[str]) -> None:
        """Begin without a past, for frames of which these columns are filtered."""
        self._keep = float(np.exp(-STEP_S / TIME_CONSTANT_S))
        self._columns = tuple(columns)
        self._before: dict[str, int] = {}
        self._values = np.zeros((len(self._columns), 0))

    def filtered(self, frame: Frame) -> Frame:
        """Return the next frame, values rounded to 1e-4; a vehicle's first one is taken as it is."""
        names = frame.vehicle_id.tolist()
        now = np.stack([getattr(frame, column) for column in self._columns])
        row = np.array([self._before.get(name, -1) for name in names], dtype=np.int64)
        known = row >= 0
        now[:, known] += self._keep * (self._values[:, row[known]] - now[:, known])
        self._before, self._values = {name: place for place, name in enumerate(names)}, now
        values: dict[str, Any] = {column: rounded(getattr(frame, column)) for column in EXACT}
        return replace(frame, **values | dict(zip(self._columns, rounded(now), strict=True)))
