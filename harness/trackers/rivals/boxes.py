"""Geometry of boxes from above: overlap, and distance where they do not overlap."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmpf.numerics.arrays import BoolArray, FloatArray, turned

# The corners of a box, in shares of its half-length and half-width, counter-clockwise.
_CORNERS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
_TOUCHING_M = 1e-9


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
    common = _common_area(corners, half)
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


def _common_area(corners: FloatArray, half: FloatArray) -> FloatArray:
    """Return the area that boxes with corners (p, 4, 2) share with rectangles around the origin, half sizes (p, 2)."""
    own = _CORNERS * half[:, None, :]
    edges = np.roll(corners, -1, axis=1) - corners
    inside = (np.abs(corners) <= half[:, None, :] + _TOUCHING_M).all(axis=-1)
    to_own = own[:, None, :, :] - corners[:, :, None, :]
    is_left = _cross(edges[:, :, None, :], to_own) >= -_TOUCHING_M
    own_inside = is_left.all(axis=1)
    crossings, do_cross = _crossings(corners, edges, own)
    points = np.concatenate([corners, own, crossings], axis=1)
    counts = np.concatenate([inside, own_inside, do_cross], axis=1)
    number = counts.sum(axis=1)
    middle = np.where(counts[..., None], points, 0.0).sum(axis=1) / np.maximum(number, 1)[:, None]
    # Points that don't count take the middle's place; between two neighbours in order they would spoil the outline.
    offset = np.where(counts[..., None], points - middle[:, None, :], 0.0)
    direction = np.where(counts, np.arctan2(offset[..., 1], offset[..., 0]), np.inf)
    order = np.argsort(direction, axis=1, kind="stable")
    outline = np.take_along_axis(offset, order[..., None], axis=1)
    position = np.arange(points.shape[1])
    following = np.where(position + 1 < number[:, None], position + 1, 0)
    after = np.take_along_axis(outline, following[..., None], axis=1)
    area = 0.5 * np.where(position < number[:, None], _cross(outline, after), 0.0).sum(axis=1)
    return np.where(number >= 3, np.maximum(area, 0.0), 0.0)


def _crossings(corners: FloatArray, edges: FloatArray, own: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return where each edge of a box crosses each edge of a rectangle, shape (p, 16, 2), and whether it does."""
    own_edges = np.roll(own, -1, axis=1) - own
    edge, own_edge = edges[:, :, None, :], own_edges[:, None, :, :]
    between = own[:, None, :, :] - corners[:, :, None, :]
    slant = _cross(edge, own_edge)
    parallel = np.abs(slant) < _TOUCHING_M
    safe = np.where(parallel, 1.0, slant)
    on_edge, on_own = _cross(between, own_edge) / safe, _cross(between, edge) / safe
    crosses = ~parallel & (on_edge >= 0.0) & (on_edge <= 1.0) & (on_own >= 0.0) & (on_own <= 1.0)
    points = corners[:, :, None, :] + on_edge[..., None] * edge
    return points.reshape(len(corners), 16, 2), crosses.reshape(len(corners), 16)


def _cross(first: FloatArray, second: FloatArray) -> FloatArray:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
