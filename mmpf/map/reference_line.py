"""The reference line of a road frame: conversion between distances along and across it and the Cartesian plane."""

from functools import cached_property

import numpy as np

from mmpf.numerics.arrays import FloatArray, IntArray

# A segment that faces a position goes before one that is nearer but does not.
FACING_FIRST = 1e6
STRAIGHT = ((0.0, 0.0), (1.0, 0.0))
"""Along this line the frame is the plane itself."""


class OnReferenceLine:
    """The frame of a road that a line of straight pieces carries, which goes on straight beyond its ends; see ``Road``.

    Attributes:
        reference_xy: Points (x, y) of the line, metres, at least two.
        reference_start_m: Longitudinal position of the first, metres.
    """

    reference_xy: tuple[tuple[float, float], ...]
    reference_start_m: float

    @cached_property
    def _vertices(self) -> FloatArray:
        return np.asarray(self.reference_xy, dtype=np.float64)

    @cached_property
    def _segment_headings(self) -> FloatArray:
        steps = np.diff(self._vertices, axis=0)
        return np.arctan2(steps[:, 1], steps[:, 0])

    @cached_property
    def _vertex_lon(self) -> FloatArray:
        lengths = np.hypot(*np.diff(self._vertices, axis=0).T)
        return self.reference_start_m + np.concatenate([[0.0], np.cumsum(lengths)])

    @cached_property
    def _segment_lengths(self) -> FloatArray:
        return np.diff(self._vertex_lon)

    @cached_property
    def _mitres(self) -> tuple[FloatArray, FloatArray]:
        """How far each segment's start and end shift along it per metre to the left, so that parallels join up."""
        half_turn = np.tan(0.5 * np.diff(self._segment_headings))
        return np.concatenate([[0.0], half_turn]), np.concatenate([-half_turn, [0.0]])

    @property
    def is_straight(self) -> bool:
        """Whether the frame is the Cartesian plane up to a turn and a shift."""
        return len(self.reference_xy) == 2

    def _segment_at(self, lon_m: FloatArray) -> IntArray:
        return np.asarray(np.searchsorted(self._vertex_lon[1:-1], lon_m, side="right"))

    def heading_at(self, lon_m: FloatArray) -> FloatArray:
        """Return the Cartesian direction of the reference line, radians counter-clockwise, the shape of ``lon_m``."""
        return np.asarray(self._segment_headings[self._segment_at(lon_m)])

    def to_cartesian(self, lon_m: FloatArray, lat_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Map road-frame positions, metres, to Cartesian x and y, metres, in the arguments' shape.

        Parallels of the reference line bend with it and are mitred at its vertices, so that the map has neither gaps
        nor overlaps up to the line's radius of curvature.
        """
        segment = self._segment_at(lon_m)
        heading = self._segment_headings[segment]
        along = lon_m - self._vertex_lon[segment]
        start, end = self._mitres
        share = np.clip(along / self._segment_lengths[segment], 0.0, 1.0)
        along = along + lat_m * (start[segment] + (end - start)[segment] * share)
        origin = self._vertices[segment]
        x = origin[..., 0] + along * np.cos(heading) - lat_m * np.sin(heading)
        y = origin[..., 1] + along * np.sin(heading) + lat_m * np.cos(heading)
        return x, y

    def to_road(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Undo ``to_cartesian``: map x and y, metres, (n,), to longitudinal and lateral position, metres, each (n,).

        Where several segments face a position the nearest counts.
        """
        cosine, sine = np.cos(self._segment_headings), np.sin(self._segment_headings)
        offset_x = np.asarray(x)[:, None] - self._vertices[None, :-1, 0]
        offset_y = np.asarray(y)[:, None] - self._vertices[None, :-1, 1]
        along = offset_x * cosine + offset_y * sine
        across = -offset_x * sine + offset_y * cosine
        start, end = self._mitres
        lower, upper = across * start, self._segment_lengths + across * end
        share = np.clip((along - lower) / np.maximum(upper - lower, 1e-9), 0.0, 1.0)
        lower[:, 0], upper[:, -1] = -np.inf, np.inf
        overshoot = np.abs(along - np.clip(along, lower, np.maximum(lower, upper)))
        nearest = np.argmin(np.abs(across) + FACING_FIRST * overshoot, axis=1)
        rows = np.arange(len(nearest))
        shift = across * (start + (end - start) * share)
        return self._vertex_lon[nearest] + (along - shift)[rows, nearest], across[rows, nearest]
