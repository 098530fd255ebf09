"""Smooths SUMO's motion: its drivers brake and stop drifting from one step to the next, real ones take time.

Every quantity is averaged with the same weights over half a second to either side. The average is linear, so positions
remain the integral of the speeds, speeds that of the accelerations, and a gap in one lane that was positive stays so.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from harness.truth.frame import Frame
from mmpf.map.corridor_road import CorridorRoad
from mmpf.numerics.arrays import FloatArray

HALF_WIDTH_S = 0.5
DECIMALS = 4
SMOOTHED = ("lon_m", "lat_m", "heading_rad", "speed_mps", "lat_speed_mps", "accel_mps2")


def lead_frames(step_s: float) -> int:
    """Return how many frames before the first and after the last smoothed one are needed."""
    return round(HALF_WIDTH_S / step_s)


def smoothed(frames: Iterable[Frame], road: CorridorRoad, step_s: float) -> Iterator[Frame]:
    """Yield smoothed frames, numbered from 0, values rounded to 1e-4.

    A vehicle that is not in all frames averaged is left out.
    """
    reach = lead_frames(step_s)
    weights = hann_weights(reach)
    window: deque[Frame] = deque(maxlen=2 * reach + 1)
    rows: deque[dict[str, int]] = deque(maxlen=2 * reach + 1)
    step = 0
    for frame in frames:
        window.append(frame)
        rows.append({str(name): row for row, name in enumerate(frame.vehicle_id)})
        if len(window) == 2 * reach + 1:
            yield _average(window, rows, weights, road, step, step_s)
            step += 1


def hann_weights(reach: int) -> FloatArray:
    """Return the weights of a raised cosine over ``2 reach + 1`` samples, summing to one."""
    window = np.hanning(2 * reach + 3)[1:-1]
    return np.asarray(window / window.sum())


def _average(
    window: deque[Frame], rows: deque[dict[str, int]], weights: FloatArray, road: CorridorRoad, step: int, step_s: float
) -> Frame:
    middle = window[len(window) // 2]
    names = [str(name) for name in middle.vehicle_id]
    kept = [name for name in names if all(name in present for present in rows)]
    at_middle = [rows[len(rows) // 2][name] for name in kept]
    totals = np.zeros((len(SMOOTHED), len(kept)))
    for frame, present, weight in zip(window, rows, weights, strict=True):
        chosen = [present[name] for name in kept]
        totals += weight * np.stack([getattr(frame, column)[chosen] for column in SMOOTHED])
    # Adding zero turns -0.0 into 0.0.
    values = dict(zip(SMOOTHED, np.round(totals, DECIMALS) + 0.0, strict=True))
    return replace(
        middle,
        step=step,
        time_s=round(step * step_s, 6),
        vehicle_id=middle.vehicle_id[at_middle],
        lane=road.lane_number_at(values["lon_m"], values["lat_m"]),
        length_m=np.round(middle.length_m[at_middle], DECIMALS),
        width_m=np.round(middle.width_m[at_middle], DECIMALS),
        **values,
    )
