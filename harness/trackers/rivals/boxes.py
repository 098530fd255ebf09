"""Geometry of boxes from above: overlap, and distance where they do not overlap."""

from dataclasses import dataclass

import numpy as np
import shapely

from mmpf.numerics.arrays import FloatArray, turned

# The corners of a box, in shares of its half-length and half-width, counter-clockwise.
_CORNERS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])


@dataclass(frozen=True)
class FlatBoxes:
    """Rectangles in the plane by their middles and the directions of their long sides, arrays of one shape."""

    x_m: FloatArray
    y_m: FloatArray
    length_m: FloatArray
    width_m: FloatArray
    heading_rad: FloatArray


def generalised_overlap(first: FlatBoxes, second: FlatBoxes) -> FloatArray:
    """Return the generalised intersection over union of p pairs of boxes, shape (p,), -1 to 1.

    From the share of the union that is common (Rezatofighi et al., CVPR 2019) the share of an enclosing shape that
    neither covers is taken off; the enclosing shape is the smallest rectangle in line with the first box.

    Args:
        first: The first box of each pair, shape (p,).
        second: The second one.
    """
    corners = _corners_seen_from(first, second)
    half = np.stack([0.5 * first.length_m, 0.5 * first.width_m], axis=-1)
    own = shapely.box(-half[:, 0], -half[:, 1], half[:, 0], half[:, 1])
    common = shapely.area(shapely.intersection(own, shapely.polygons(corners)))
    union = first.length_m * first.width_m + second.length_m * second.width_m - common
    highest = np.maximum(corners.max(axis=1), half)
    lowest = np.minimum(corners.min(axis=1), -half)
    enclosing = np.prod(highest - lowest, axis=-1)
    return np.asarray(common / union - (enclosing - union) / enclosing)


def _corners_seen_from(first: FlatBoxes, second: FlatBoxes) -> FloatArray:
    """Return the corners of the second boxes along and across the first ones, shape (p, 4, 2)."""
    along, across = turned(second.x_m - first.x_m, second.y_m - first.y_m, first.heading_rad)
    turn = second.heading_rad - first.heading_rad
    reach = _CORNERS * 0.5 * np.stack([second.length_m, second.width_m], axis=-1)[:, None, :]
    cosine, sine = np.cos(turn)[:, None], np.sin(turn)[:, None]
    x = along[:, None] + reach[:, :, 0] * cosine - reach[:, :, 1] * sine
    y = across[:, None] + reach[:, :, 0] * sine + reach[:, :, 1] * cosine
    return np.stack([x, y], axis=-1)
