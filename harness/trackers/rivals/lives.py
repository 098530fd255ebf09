"""Lifetimes of tracks: counters of hits and misses, which tracks are kept and which are reported."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.trackers.kalman import tracks_of
from harness.trackers.rivals.options import RivalOptions
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.scan import EgoPose
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


def remembered(lives: Lives, lon_m: FloatArray, lat_m: FloatArray, now: ScanMoment, options: RivalOptions) -> BoolArray:
    """Return which tracks are kept, shape (n,): those within range and not unseen for too long.

    Args:
        lives: Their lives.
        lon_m: Longitudinal positions, shape (n,).
        lat_m: Lateral positions, shape (n,).
        now: The time, and where the sensor is.
        options: How long and how far.
    """
    longest_s = np.where(lives.confirmed(options), options.longest_unseen_s, options.held_unseen_s)
    away_m = np.hypot(lon_m - now.ego.lon_m, lat_m - now.ego.lat_m)
    is_recent = now.time_s - lives.last_seen_s <= longest_s + TIME_TOLERANCE_S
    return np.asarray(is_recent & (away_m <= now.range_m + RANGE_MARGIN_M))


@dataclass(frozen=True)
class ScanMoment:
    """A scan's time, the sensor's pose at it and its range."""

    time_s: float
    ego: EgoPose
    range_m: float


def reported(
    lives: Lives,
    mean: FloatArray,
    covariance: FloatArray,
    time_s: float,
    options: RivalOptions,
    existence: FloatArray | None = None,
) -> Tracks:
    """Return tracks as they are reported.

    Args:
        lives: Their lives.
        mean: Means that begin with ``LON, SPEED, LAT, LAT_SPEED``, shape (n, 4 or more).
        covariance: Covariances of the same order.
        time_s: Now.
        options: When a track is confirmed, and when hidden.
        existence: Probability that each is a vehicle, shape (n,); one if None.
    """
    std = np.maximum(np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 0.0)), SMALLEST_STD)
    confirmed = lives.confirmed(options)
    hidden = confirmed & (time_s - lives.last_seen_s > options.hidden_after_s + TIME_TOLERANCE_S)
    return tracks_of(
        lives.track_id.astype(np.int64),
        mean,
        std,
        np.select([hidden, confirmed], [HIDDEN, CONFIRMED], TENTATIVE).astype(np.int8),
        None if existence is None else np.clip(existence, 0.0, 1.0),
    )
