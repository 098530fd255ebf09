"""Headings of vehicles where positions are in the plane: gates and errors are along and across them.

On a road with a frame of its own every direction is 0, and the frame's axes are those of all gates and errors.
"""

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from mmpf.numerics.arrays import FloatArray, IntArray, turned

# Farther than any two places of one step are apart.
BETWEEN_STEPS_M = 1e9


def read_directions(truth: pd.DataFrame) -> FloatArray:
    """Return the directions of a truth table's rows, shape (n,); zeros where the road has a frame of its own.

    Raises:
        ValueError: A direction is not finite.
    """
    if "direction_rad" not in truth:
        return np.zeros(len(truth))
    direction = truth["direction_rad"].to_numpy(dtype=np.float64, na_value=np.nan)
    if not np.isfinite(direction).all():
        raise ValueError("truth: direction_rad holds a value that is not finite")
    return direction


def along_and_across(lon_m: FloatArray, lat_m: FloatArray, direction_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return differences along the frame's axes as those along directions and to the left of them; all (n,)."""
    if not direction_rad.any():
        return lon_m, lat_m
    return turned(lon_m, lat_m, direction_rad)


def along_axes(along_m: FloatArray, across_m: FloatArray, direction_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Undo ``along_and_across``; all (n,)."""
    return along_and_across(along_m, across_m, -direction_rad)


def nearest_row(
    step: IntArray,
    lon_m: FloatArray,
    lat_m: FloatArray,
    of_step: IntArray,
    of_lon_m: FloatArray,
    of_lat_m: FloatArray,
) -> IntArray:
    """Return the row of the vehicle, the ego among them, that is nearest to each detection at its step, shape (d,).

    A detection has no direction, yet its gate has a longer side. It lies along the vehicle nearest to it, whether the
    detection came from that one, from another one or from none: so the gate depends on the place alone, and a false
    detection has the gate that a true one would have there.

    Args:
        step: Step of each detection, shape (d,); each must have a vehicle.
        lon_m: Where it is, shape (d,).
        lat_m: Likewise.
        of_step: Step of each row of the truth table, shape (n,).
        of_lon_m: Where the vehicle is, shape (n,).
        of_lat_m: Likewise.
    """
    if not len(step):
        return np.zeros(0, dtype=np.int64)
    tree = cKDTree(np.column_stack([of_lon_m, of_lat_m, of_step * BETWEEN_STEPS_M]))
    nearest = tree.query(np.column_stack([lon_m, lat_m, step * BETWEEN_STEPS_M]))[1]
    return np.asarray(nearest, dtype=np.int64)
