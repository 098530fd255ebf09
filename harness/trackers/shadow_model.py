"""Detection probabilities of a tracker's own tracks, given that they occlude one another.

Nothing here is told by the truth: bodies and shadows are those of the tracks.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmpf.map.sensor_plane import SensorPlane
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.scan import SensorModel
from mmpf.visibility.depth import DepthTable, Occluders
from mmpf.visibility.shadows import visible_fractions

# Five points that stand for a Gaussian, in standard deviations, and what they weigh.
POINTS, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()


@dataclass(frozen=True)
class Visibility:
    """The sensor's data sheet, and the detection probabilities in plain view and, the least of all, when hidden."""

    sensor: SensorModel
    in_view: float
    hidden: float


def detection_probabilities(
    plane: SensorPlane,
    places: tuple[FloatArray, FloatArray, IntArray],
    bodies: Occluders,
    table: DepthTable,
    visibility: Visibility,
) -> FloatArray:
    """Return the mean detection probability over where each of m vehicles may be, shape (m,).

    Args:
        places: Longitudinal and lateral positions at ``POINTS`` of each vehicle, shape (5 m,), and by whose shadow each
            point is not darkened, shape (5 m,).
    """
    lon, lat, component = places
    sensor = visibility.sensor
    visible = visible_fractions(plane, lon, lat, component, bodies, table)
    share = np.clip(visible / max(sensor.full_view_fraction, 1e-6), 0.0, 1.0)
    can_be_seen = (visible >= sensor.hidden_fraction) & (plane.distance_m(lon, lat) <= sensor.range_m)
    probability = np.where(can_be_seen, visibility.in_view * share, 0.0)
    return np.asarray(np.maximum(probability, visibility.hidden).reshape(-1, len(POINTS)) @ _WEIGHTS, dtype=np.float64)
