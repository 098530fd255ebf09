"""The sensor's field of view: a vehicle outside it is neither missed nor removed."""

import numpy as np

from mmpf.map.sensor_plane import SensorPlane
from mmpf.numerics.arrays import FloatArray
from mmpf.scan import FreeSpace, SensorModel


def share_in_field(
    plane: SensorPlane, lon_m: FloatArray, lat_m: FloatArray, half_width_m: FloatArray, free_space: FreeSpace | None
) -> FloatArray | None:
    """Return the share of each vehicle's angular extent in the field of view, shape (n,); None if that is all around.

    Sectors of no free distance at all lie outside.

    Args:
        plane: The plane around the sensor.
        lon_m: Longitudinal positions, shape (n,).
        lat_m: Lateral positions, shape (n,).
        half_width_m: Half the extent of each vehicle across the line of sight, shape (n,).
        free_space: What the sensor knows of its shadows; None if it does not say.
    """
    if free_space is None or (free_space.range_m > 0.0).all():
        return None
    sectors = len(free_space.range_m)
    # The integral over bearing of what is open, over three turns, so that no extent crosses its ends.
    open_before = np.concatenate([[0.0], np.cumsum(np.tile(free_space.range_m > 0.0, 3))])
    x, y = plane.seen_from_sensor(lon_m, lat_m)
    half = np.arctan(half_width_m / np.maximum(np.hypot(x, y), 1e-6))
    bearing = (np.arctan2(y, x) + plane.turn_rad + np.pi) % (2.0 * np.pi) + 2.0 * np.pi
    per_rad = sectors / (2.0 * np.pi)
    places = np.arange(len(open_before))
    first, last = (np.interp((bearing + side * half) * per_rad, places, open_before) for side in (-1.0, 1.0))
    return np.asarray((last - first) / (2.0 * half * per_rad))


def half_widths(length_m: FloatArray, width_m: FloatArray) -> FloatArray:
    """Return half the extent of vehicles across the line of sight for any heading, (m,)."""
    return np.asarray(0.25 * (length_m + width_m))


def worth_at_edge(in_field: FloatArray, sensor: SensorModel, hidden_probability: float) -> FloatArray:
    """Return the factor on detection probabilities at the edge of the field of view, the shape of ``in_field``.

    Args:
        in_field: Share of each vehicle in the field of view.
        sensor: The data sheet.
        hidden_probability: What remains outside: the edge may be wrong.
    """
    inside = np.minimum(in_field / sensor.full_view_fraction, 1.0)
    return np.where(in_field < sensor.hidden_fraction, hidden_probability, inside)
