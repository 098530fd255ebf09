"""Pairs of nearby tracks and vehicles, and their distances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.scoring.evidence.directions import along_and_across
from harness.scoring.evidence.rows import DetectionRows, TrackRows, TruthRows
from harness.scoring.evidence.rules import GATE_LAT_M, GATE_LON_M
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class TrackPairs:
    """Rows of a vehicle and a track of one step that lie near each other, and their ``similarity``; shape (p,)."""

    truth: IntArray
    track: IntArray
    similarity: FloatArray

    def where(self, keep: BoolArray) -> TrackPairs:
        """Return the chosen pairs."""
        return TrackPairs(self.truth[keep], self.track[keep], self.similarity[keep])


GATE_SIMILARITY = 0.5
"""Similarity on the edge of the gate."""


def similarity(lon_difference_m: FloatArray, lat_difference_m: FloatArray) -> FloatArray:
    """Return ``1 - max(|dlon| / 2 gate_lon, |dlat| / 2 gate_lat)``, clipped at 0; arrays of one shape."""
    scaled_lon = np.abs(lon_difference_m) / (2.0 * GATE_LON_M)
    scaled_lat = np.abs(lat_difference_m) / (2.0 * GATE_LAT_M)
    return np.maximum(0.0, 1.0 - np.maximum(scaled_lon, scaled_lat))


def near_pairs(truth: TruthRows, tracks: TrackRows) -> TrackPairs:
    """Return all pairs of one step with a similarity above 0."""
    near = pairs_near(truth, tracks, 2.0 * GATE_LON_M)
    return near.where(near.similarity > 0.0)


def pairs_near(first: TruthRows | DetectionRows, tracks: TrackRows, reach_m: float) -> TrackPairs:
    """Return all pairs of one step within the reach, and some beyond it; ``truth`` is a row of first.

    The reach is that along ``first``'s direction; across it, it is as far as there is any similarity.
    """
    if first.direction_rad.any():
        reach_m = float(np.hypot(reach_m, 2.0 * GATE_LAT_M))
    row, track = _rows_near(first, tracks, reach_m)
    lon_m, lat_m = first.lon_m[row] - tracks.lon_m[track], first.lat_m[row] - tracks.lat_m[track]
    alike = similarity(*along_and_across(lon_m, lat_m, first.direction_rad[row]))
    return TrackPairs(row, track, alike)


def _rows_near(first: TruthRows | DetectionRows, second: TrackRows, reach_m: float) -> tuple[IntArray, IntArray]:
    """Return the pairs' rows of ``first`` and of ``second``, both of shape (p,), ordered by the latter.

    Sorting by step and position lets one binary search per row of ``second`` find its neighbours, so the cost does not
    grow with rows times rows.
    """
    if not len(first.step) or not len(second.step):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    reach_m += 1e-3
    lowest = min(first.lon_m.min(), second.lon_m.min())
    span = max(first.lon_m.max(), second.lon_m.max()) - lowest + 3.0 * reach_m
    first_key = first.step * span + (first.lon_m - lowest)
    second_key = second.step * span + (second.lon_m - lowest)
    order = np.argsort(first_key)
    begin = np.searchsorted(first_key[order], second_key - reach_m)
    count = np.searchsorted(first_key[order], second_key + reach_m) - begin
    second_row = np.repeat(np.arange(len(second_key)), count)
    offset = np.arange(len(second_row)) - np.repeat(np.cumsum(count) - count, count)
    return order[begin[second_row] + offset], second_row
