"""What a visible fraction is worth: the probabilities that the sensor detects each particle's vehicle."""

from __future__ import annotations

import numba
import numpy as np

from mmpf.compute.arrays import FloatArray
from mmpf.scan import SensorModel


def detection_probabilities(
    visible_fraction: FloatArray, distance_m: FloatArray, sensor: SensorModel, hidden_probability: float
) -> FloatArray:
    """Return the probability of a detection given the visible fraction, the sensor's data sheet as a function.

    Args:
        visible_fraction: Visible fraction, shape (n,).
        distance_m: Distance from the sensor, shape (n,).
        sensor: The data sheet.
        hidden_probability: What remains for a vehicle that seems hidden: the shadow may be wrong.
    """
    probability = np.empty(len(visible_fraction))
    _by_data_sheet(
        visible_fraction,
        distance_m,
        sensor.detection_probability,
        sensor.full_view_fraction,
        sensor.hidden_fraction,
        sensor.range_m,
        hidden_probability,
        probability,
    )
    return probability


@numba.njit(cache=True, nogil=True)
def _by_data_sheet(
    visible: FloatArray,
    distance: FloatArray,
    in_plain_view: float,
    full_view_fraction: float,
    hidden_fraction: float,
    range_m: float,
    hidden: float,
    probability: FloatArray,
) -> None:
    per_fraction = 1.0 / full_view_fraction
    for n in range(len(visible)):
        is_unseen = (visible[n] < hidden_fraction) | (distance[n] > range_m)
        probability[n] = hidden if is_unseen else in_plain_view * min(1.0, visible[n] * per_fraction)
