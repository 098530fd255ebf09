"""Tracking by detection as in automated driving: a Kalman filter for each box, matched by overlap.

Written after AB3DMOT (Weng, Wang, Held and Kitani, IROS 2020) and SimpleTrack (Pang, Li and Wang, 2021): a box's
middle moves at a nearly constant velocity, its size and direction hardly change, and each scan's boxes are assigned to
the predicted ones by their generalised overlap from above. Confirmed tracks choose first, unconfirmed ones among what
is left; the scans of this project carry no scores by which detections could take turns.
"""

from typing import Literal

import numpy as np

from harness.trackers.plane import is_in_plane
from harness.trackers.protocol import TrackerSetting
from harness.trackers.rivals.box_tracks import BoxOptions, BoxTracks, begun, none_begun, overlaps, predicted, taken_in
from harness.trackers.rivals.gaussian import best_pairs, pairs_of
from harness.trackers.rivals.lives import Lives, remembered, reported
from harness.trackers.track_options import factory
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, joined, taken
from mmpf.scan import Detections, Scan
from mmpf.tracks import Tracks


class BoxKalmanOptions(BoxOptions):
    """Settings of the tracker of boxes."""

    association: Literal["overlap", "mahalanobis"] = "overlap"
    """Distance used in association: the generalised overlap of the boxes in the top view, or the distance of their
    centres in standard deviations.
    """


class BoxKalman:
    """A Kalman filter of each vehicle's box, matched to detections by generalised overlap."""

    def __init__(self, options: BoxKalmanOptions, setting: TrackerSetting) -> None:
        self._options, self._sensor, self._in_plane = options, setting.sensor, is_in_plane(setting)
        self._time_s: float | None = None
        self._next_track_id = 1
        self._tracks = none_begun(options)

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return the tracks; see ``Tracker``."""
        options, detections = self._options, scan.detections
        if self._time_s is not None:
            self._tracks = predicted(self._tracks, scan.time_s - self._time_s, options, self._in_plane)
        self._time_s = scan.time_s
        tracks = self._tracks
        tracks = taken(tracks, remembered(tracks.lives, tracks.states, scan, self._sensor.range_m, options))
        index, detection = _matched(tracks, detections, options)
        tracks = taken_in(tracks, index, detections, detection, scan.time_s)
        others = np.setdiff1d(np.arange(len(detections)), detection)
        lives = Lives.begun(self._next_track_id, len(others), scan.time_s)
        self._next_track_id += len(others)
        self._tracks = joined(tracks, begun(lives, taken(detections, others), scan.ego, options))
        return reported(self._tracks.lives, self._tracks.states, scan.time_s, options)


build_box_kalman = factory(BoxKalmanOptions, BoxKalman)


def _matched(tracks: BoxTracks, detections: Detections, options: BoxKalmanOptions) -> tuple[IntArray, IntArray]:
    """Return pairs of tracks and detections, first of confirmed tracks, then of the others."""
    gain, allowed = _gains(tracks, detections, options)
    confirmed = tracks.lives.confirmed(options)
    first = best_pairs(gain, allowed & confirmed[:, None])
    left = np.ones(len(detections), dtype=np.bool_)
    left[first[1]] = False
    second = best_pairs(gain, allowed & ~confirmed[:, None] & left)
    return np.concatenate([first[0], second[0]]), np.concatenate([first[1], second[1]])


def _gains(tracks: BoxTracks, detections: Detections, options: BoxKalmanOptions) -> tuple[FloatArray, BoolArray]:
    """Return the gain of matching each track with each detection, and whether the match is allowed, shape (n, d)."""
    if options.association == "mahalanobis":
        squared, _ = pairs_of(tracks.states.mean, tracks.states.covariance, detections)
        return options.gate_std**2 - squared, squared <= options.gate_std**2
    overlap = overlaps(tracks, tracks.middle_m, detections, options)
    return overlap - options.least_overlap + 1e-9, overlap >= options.least_overlap
