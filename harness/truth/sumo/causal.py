"""SUMO's vehicles at the moment that they are read, for a loop that acts on them: nothing waits for what comes later.

``smoothing`` averages half a second to either side, so its frames are half a second old when they come. Here positions
and speeds are those of the moment. What SUMO changes from one step to the next, and real vehicles do not, is filtered
by what went before alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.truth.frame import Frame
from harness.truth.sumo.smoothing import DECIMALS

TIME_CONSTANT_S = 0.3
FILTERED = ("heading_rad", "lat_speed_mps", "accel_mps2")
EXACT = ("lon_m", "lat_m", "speed_mps", "length_m", "width_m")


class CausalFilter:
    """A filter of first order over headings, lateral speeds and accelerations, vehicle by vehicle."""

    def __init__(self, step_s: float) -> None:
        """Begin without a past, for frames of a step."""
        self._keep = float(np.exp(-step_s / TIME_CONSTANT_S))
        self._before: dict[str, int] = {}
        self._values = np.zeros((len(FILTERED), 0))

    def filtered(self, frame: Frame) -> Frame:
        """Return the next frame, values rounded to 1e-4; a vehicle's first one is taken as it is."""
        names = frame.vehicle_id.tolist()
        now = np.stack([getattr(frame, column) for column in FILTERED])
        row = np.array([self._before.get(name, -1) for name in names], dtype=np.int64)
        known = row >= 0
        now[:, known] += self._keep * (self._values[:, row[known]] - now[:, known])
        self._before, self._values = {name: place for place, name in enumerate(names)}, now
        exact = {column: np.round(getattr(frame, column), DECIMALS) + 0.0 for column in EXACT}
        smooth = dict(zip(FILTERED, np.round(now, DECIMALS) + 0.0, strict=True))
        if frame.direction_rad is not None:
            # In the plane headings go round, and those of a rolling axle are smooth already.
            smooth["heading_rad"] = frame.heading_rad
        return replace(frame, **exact, **smooth)
