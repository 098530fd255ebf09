"""The detection probability of each particle's vehicle, given its visible fraction."""

import numpy as np

from mmpf.numerics.arrays import FloatArray
from mmpf.numerics.kernels import kernel
from mmpf.scan import SensorModel

# What is learned makes no sensor certain: a single miss would prove that nobody is there.
LARGEST_LEARNED = 0.99


def detection_probabilities(
    visible_fraction: FloatArray,
    distance_m: FloatArray,
    sensor: SensorModel,
    reach_shares: FloatArray,
    hidden_probability: float,
) -> FloatArray:
    """Return the probability of a detection given the visible fraction, the sensor's data sheet as a function.

    Args:
        visible_fraction: Visible fraction, shape (n,).
        distance_m: Distance from the sensor, shape (n,).
        sensor: The data sheet.
        reach_shares: What remains of its detection probability in each ring around the sensor, see
            ``mmpf.visibility.range_profile``, shape (rings,).
        hidden_probability: What remains for a vehicle that seems hidden: the shadow may be wrong.
    """
    probability = np.empty(len(visible_fraction))
    in_rings = in_plain_view(sensor, reach_shares)
    sheet = sensor.full_view_fraction, sensor.hidden_fraction, sensor.range_m
    _by_data_sheet(visible_fraction, distance_m, in_rings, *sheet, hidden_probability, probability)
    return probability


def in_plain_view(sensor: SensorModel, reach_shares: FloatArray) -> FloatArray:
    """Return the detection probability of a vehicle in plain view, given the remaining share of the data sheet's."""
    promised = sensor.detection_probability
    return np.minimum(promised * reach_shares, max(promised, LARGEST_LEARNED))


@kernel()
def _by_data_sheet(
    visible: FloatArray,
    distance: FloatArray,
    in_rings: FloatArray,
    full_view_fraction: float,
    hidden_fraction: float,
    range_m: float,
    hidden: float,
    probability: FloatArray,
) -> None:
    per_fraction = 1.0 / full_view_fraction
    last = len(in_rings) - 1
    rings_per_m = len(in_rings) / range_m
    for n in range(len(visible)):
        is_unseen = (visible[n] < hidden_fraction) | (distance[n] > range_m)
        rings = min(max(distance[n] * rings_per_m - 0.5, 0.0), float(last))
        inner = min(int(rings), last - 1)
        in_view = in_rings[inner] + (rings - inner) * (in_rings[inner + 1] - in_rings[inner])
        probability[n] = hidden if is_unseen else in_view * min(1.0, visible[n] * per_fraction)
