"""Which tracks lie near which vehicles, and how near."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.scoring.rows import BoolArray, TrackRows, TruthRows
from harness.scoring.settings import ScoringSettings
from mmpf.road import FloatArray, IntArray


@dataclass(frozen=True)
class Pairs:
    """Pairs of a vehicle and a track of one step that lie near each other, struct of arrays of shape (p,).

    Attributes:
        truth: Row of ``TruthRows``.
        track: Row of ``TrackRows``.
        similarity: ``similarity`` of the two, in (0, 1]; 0.5 on the edge of the gate.
    """

    truth: IntArray
    track: IntArray
    similarity: FloatArray

    def where(self, keep: BoolArray) -> Pairs:
        """Return the chosen pairs."""
        return Pairs(self.truth[keep], self.track[keep], self.similarity[keep])


GATE_SIMILARITY = 0.5
"""Similarity on the edge of the gate."""


def similarity(lon_difference_m: FloatArray, lat_difference_m: FloatArray, settings: ScoringSettings) -> FloatArray:
    """Return ``1 - max(|dlon| / 2 gate_lon, |dlat| / 2 gate_lat)``, clipped at 0; arrays of one shape."""
    scaled_lon = np.abs(lon_difference_m) / (2.0 * settings.gate_lon_m)
    scaled_lat = np.abs(lat_difference_m) / (2.0 * settings.gate_lat_m)
    return np.maximum(0.0, 1.0 - np.maximum(scaled_lon, scaled_lat))


def near_pairs(truth: TruthRows, tracks: TrackRows, settings: ScoringSettings) -> Pairs:
    """Return all pairs of one step with a similarity above 0.

    Sorting by step and position lets one binary search per track find its neighbours, so the cost does not grow
    with vehicles times tracks.
    """
    if not len(truth) or not len(tracks):
        empty = np.zeros(0, dtype=np.int64)
        return Pairs(empty, empty, np.zeros(0))
    reach_m = 2.0 * settings.gate_lon_m + 1e-3
    lowest = min(truth.lon_m.min(), tracks.lon_m.min())
    span = max(truth.lon_m.max(), tracks.lon_m.max()) - lowest + 3.0 * reach_m
    truth_key = truth.step * span + (truth.lon_m - lowest)
    track_key = tracks.step * span + (tracks.lon_m - lowest)
    order = np.argsort(truth_key)
    first = np.searchsorted(truth_key[order], track_key - reach_m)
    count = np.searchsorted(truth_key[order], track_key + reach_m) - first
    track_row = np.repeat(np.arange(len(tracks)), count)
    offset = np.arange(len(track_row)) - np.repeat(np.cumsum(count) - count, count)
    truth_row = order[first[track_row] + offset]
    alike = similarity(
        truth.lon_m[truth_row] - tracks.lon_m[track_row], truth.lat_m[truth_row] - tracks.lat_m[track_row], settings
    )
    return Pairs(truth_row, track_row, alike).where(alike > 0.0)
