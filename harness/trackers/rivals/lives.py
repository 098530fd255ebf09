"""Lifetimes of tracks: counters of hits and misses, which tracks are kept and which are reported."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.trackers.kalman import LAT, LON, GaussianStates, tracks_of
from harness.trackers.track_options import RivalOptions
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.scan import Scan
from mmpf.stages.update_rule import RANGE_MARGIN_M
from mmpf.tracks import CONFIRMED, HIDDEN, TENTATIVE, Tracks

SMALLEST_STD = 1e-6
# Times of scans are sums of steps, which binary fractions hold only nearly.
TIME_TOLERANCE_S = 1e-6


@dataclass(frozen=True)
class Lives:
    """Identity, time of the last detection and number of detections of n tracks, arrays of shape (n,)."""

    track_id: IntArray
    last_seen_s: FloatArray
    detections: IntArray

    @classmethod
    def begun(cls, first_id: int, count: int, time_s: float) -> Lives:
        """Return the lives of tracks that begin with a detection each."""
        return cls(first_id + np.arange(count), np.full(count, time_s), np.ones(count, dtype=np.int64))

    def seen(self, index: IntArray, time_s: float) -> Lives:
        """Return the lives after a detection each of some tracks, shape (k,)."""
        last_seen_s, detections = self.last_seen_s.copy(), self.detections.copy()
        last_seen_s[index] = time_s
        detections[index] += 1
        return Lives(self.track_id, last_seen_s, detections)

    def confirmed(self, options: RivalOptions) -> BoolArray:
        """Return who has had enough detections, shape (n,)."""
        return self.detections >= options.confirm_detections


def remembered(lives: Lives, states: GaussianStates, scan: Scan, range_m: float, options: RivalOptions) -> BoolArray:
    """Return which tracks are kept at a scan, shape (n,): those within range and not unseen for too long."""
    longest_s = np.where(lives.confirmed(options), options.longest_unseen_s, options.held_unseen_s)
    away_m = np.hypot(states.mean[:, LON] - scan.ego.lon_m, states.mean[:, LAT] - scan.ego.lat_m)
    is_recent = scan.time_s - lives.last_seen_s <= longest_s + TIME_TOLERANCE_S
    return np.asarray(is_recent & (away_m <= range_m + RANGE_MARGIN_M))


def reported(
    lives: Lives, states: GaussianStates, time_s: float, options: RivalOptions, existence: FloatArray | None = None
) -> Tracks:
    """Return tracks as they are reported; ``existence`` is the probability that each is a vehicle, (n,), one if None.

    The options tell when a track is confirmed, and when hidden.
    """
    variance = np.diagonal(states.covariance, axis1=1, axis2=2)
    std = np.maximum(np.sqrt(np.maximum(variance, 0.0)), SMALLEST_STD)
    confirmed = lives.confirmed(options)
    hidden = confirmed & (time_s - lives.last_seen_s > options.hidden_after_s + TIME_TOLERANCE_S)
    return tracks_of(
        lives.track_id.astype(np.int64),
        states.mean,
        std,
        np.select([hidden, confirmed], [HIDDEN, CONFIRMED], TENTATIVE).astype(np.int8),
        None if existence is None else np.clip(existence, 0.0, 1.0),
    )
