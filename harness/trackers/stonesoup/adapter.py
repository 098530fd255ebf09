"""Adapts an assembled Stone Soup tracker to the tracker protocol.

Stone Soup's tracks carry no existence probability (1 is reported) and no flag for "can't be seen"; a track without an
update for ``hidden_after_s`` is reported as hidden, so that pictures show it so. Tracks that are still held by the
initiator are not reported.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.tracker.simple import MultiTargetMixtureTracker, MultiTargetTracker
from stonesoup.types.track import Track

from harness.trackers.kalman import tracks_of
from harness.trackers.stonesoup.parts import (
    BeyondRangeDeleter,
    DetectionMaker,
    NumberedInitiator,
    forget_before_last_update,
    to_datetime,
    to_seconds,
)
from harness.trackers.stonesoup.stitching import IdentityStitcher, LastSightings
from harness.trackers.track_options import TrackOptions
from mmpf.numerics.arrays import FloatArray
from mmpf.scan import Scan
from mmpf.tracks import CONFIRMED, HIDDEN, Tracks

_HIGHEST_SPEED_MPS = 40.0


class StoneSoupTracker:
    """A Stone Soup tracker, fed scan by scan."""

    def __init__(self, assembly: Assembly, options: TrackOptions, stitcher: IdentityStitcher | None = None) -> None:
        """Wrap a tracker that has been put together; without a stitcher it hands on no identities."""
        self._assembly, self._options, self._stitcher = assembly, options, stitcher
        hypothesiser = assembly.hypothesiser
        self._clutter_density_per_m2 = 0.0 if hypothesiser is None else hypothesiser.clutter_spatial_density
        self._detections = DetectionMaker()
        self._first_seen_s: dict[int, float] = {}

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return the confirmed tracks; see ``Tracker``."""
        self._follow_ego(scan)
        moment = to_datetime(scan.time_s)
        detections = self._detections.make(scan.detections, moment)
        self._assembly.tracker.update_tracker(moment, detections)
        return self._report(scan.time_s)

    def _follow_ego(self, scan: Scan) -> None:
        assembly = self._assembly
        assembly.initiator.expect_speed(scan.ego.speed_mps)
        assembly.range_deleter.ego_lon_m = scan.ego.lon_m
        assembly.range_deleter.ego_lat_m = scan.ego.lat_m
        with_speed = bool(np.isfinite(scan.detections.speed_mps).all()) and len(scan.detections) > 0
        span = _HIGHEST_SPEED_MPS if with_speed else 1.0
        if assembly.hypothesiser is not None:
            assembly.hypothesiser.clutter_spatial_density = self._clutter_density_per_m2 / span

    def _report(self, time_s: float) -> Tracks:
        living = list(self._assembly.tracker.tracks)
        # Before anything is forgotten, a new track's first state is its first detection.
        started = {track.id: to_seconds(track.states[0].timestamp) for track in living}
        self._first_seen_s = {number: self._first_seen_s.get(number, first_s) for number, first_s in started.items()}
        for track in living:
            forget_before_last_update(track)
        last_s = np.array([to_seconds(track.states[0].timestamp) for track in living])
        tracks = self._to_tracks(living, time_s - last_s)
        if self._stitcher is None:
            return tracks
        first_s = np.array([self._first_seen_s[track.id] for track in living])
        stitched, replaced = self._stitcher.stitch(tracks, LastSightings(first_s, last_s), time_s)
        for track in living:
            if track.id in replaced:
                self._assembly.tracker.tracks.discard(track)
        return stitched

    def _to_tracks(self, living: list[Track], unseen_s: FloatArray) -> Tracks:
        if not living:
            return Tracks.none()
        mean = np.array([np.asarray(track.state.mean, dtype=float).ravel() for track in living])
        covariance = np.array([np.asarray(track.state.covar, dtype=float) for track in living])
        std = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-12))
        state = np.where(unseen_s > self._options.hidden_after_s, HIDDEN, CONFIRMED).astype(np.int8)
        return tracks_of(np.array([track.id for track in living], dtype=np.int64), mean, std, state)


@dataclass(frozen=True)
class Assembly:
    """A Stone Soup tracker and those of its parts that follow the ego or the scan."""

    tracker: MultiTargetTracker | MultiTargetMixtureTracker
    initiator: NumberedInitiator
    range_deleter: BeyondRangeDeleter
    hypothesiser: PDAHypothesiser | None = None
