"""OC-SORT on boxes from above: association that trusts observations more than predictions.

Written after Cao, Pang, Weng, Khirodkar and Kitani (Observation-Centric SORT, CVPR 2023). To a Kalman filter of each
box it adds three things, by the paper's names:

- momentum: of detections that overlap a track's prediction alike, the one that lies the way that the track's
  observations went is worth more (section 4.2);
- recovery: tracks and detections that are left are matched by the overlap with the box where the track was last seen,
  for vehicles that stopped or were hidden for a moment (section 4.2);
- re-update: a track that is found again is filtered anew over a straight way from its last observation to this one, so
  that errors do not add up while it is unseen (section 4.1).

The paper's boxes lie in the image, these in the road frame. Only middles are filtered anew: sizes and directions hardly
change while a vehicle is unseen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Annotated

import numpy as np
from pydantic import Field

from harness.trackers.kalman import LAT, LON, GaussianStates, predict_constant_velocity, update_variable
from harness.trackers.plane import is_in_plane
from harness.trackers.protocol import TrackerSetting
from harness.trackers.rivals.box_tracks import BoxOptions, BoxTracks, begun, none_begun, overlaps, predicted, taken_in
from harness.trackers.rivals.gaussian import best_pairs
from harness.trackers.rivals.lives import TIME_TOLERANCE_S, Lives, remembered, reported
from harness.trackers.track_options import factory
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, joined, taken, wrapped
from mmpf.options.base import NotNegative, Positive, Probability, in_unit
from mmpf.scan import Detections, Scan
from mmpf.tracks import Tracks

_OBSERVATIONS_KEPT = 16
# Positions nearer to each other define no direction.
_LEAST_MOTION_M = 1.0


class OcSortOptions(BoxOptions):
    """Settings of OC-SORT."""

    momentum_weight: Annotated[NotNegative, in_unit("overlap")] = 0.2
    """Bonus, as overlap, of a detection in the track's direction of motion over one in the opposite direction; the
    paper's λ, for angles in half-turns.
    """
    momentum_s: Positive = 0.3
    """A track's direction starts at its observation this long before the last one (the paper's Δt), at most 16
    observations back."""
    recovery_overlap: Annotated[float, Field(ge=-1.0, le=1.0), in_unit("overlap")] = 0.3
    """Smallest overlap of an unmatched detection with the last observed box of an unmatched track for recovery; 1 turns
    it off.
    """
    sure_score: Probability = 0.0
    """A detection with a lower score starts no track and is matched last, to tracks that are left (ByteTrack, Zhang et
    al. 2022); 0 ignores scores."""
    reupdate: bool = True
    """Whether a recovered track is filtered again over the time without detections."""


@dataclass(frozen=True)
class Observations:
    """The last 16 observations of n tracks, the newest last; nan where there are fewer.

    Attributes:
        time_s: Their times, shape (n, 16).
        place_m: The detected middles, shape (n, 16, 2).
    """

    time_s: FloatArray
    place_m: FloatArray

    @classmethod
    def first(cls, time_s: float, place_m: FloatArray) -> Observations:
        """Return the observations with which tracks begin, at places of shape (n, 2)."""
        count = len(place_m)
        none = cls(np.full((count, _OBSERVATIONS_KEPT), np.nan), np.full((count, _OBSERVATIONS_KEPT, 2), np.nan))
        return none.followed(np.arange(count), time_s, place_m)

    @property
    def last_m(self) -> FloatArray:
        """Where each was last seen, shape (n, 2)."""
        return np.asarray(self.place_m[:, -1])

    def before_m(self, interval_s: float) -> FloatArray:
        """Return where each was seen at least so long before it was last seen, or else first, shape (n, 2)."""
        since_s = self.time_s[:, -1:] - self.time_s
        is_before = since_s >= interval_s - TIME_TOLERANCE_S
        newest_before = _OBSERVATIONS_KEPT - 1 - np.argmax(is_before[:, ::-1], axis=1)
        oldest = np.argmax(np.isfinite(self.time_s), axis=1)
        chosen = np.where(is_before.any(axis=1), newest_before, oldest)
        return np.asarray(self.place_m[np.arange(len(chosen)), chosen])

    def followed(self, index: IntArray, time_s: float, place_m: FloatArray) -> Observations:
        """Return the observations after one more of some tracks, shape (k,), at places of shape (k, 2)."""
        times, places = self.time_s.copy(), self.place_m.copy()
        times[index, :-1], places[index, :-1] = self.time_s[index, 1:], self.place_m[index, 1:]
        times[index, -1], places[index, -1] = time_s, place_m
        return Observations(times, places)


@dataclass(frozen=True)
class OcTracks:
    """The boxes that are followed, n of them, and what was seen of them.

    Attributes:
        when_seen: What was believed of each after its last observation.
    """

    boxes: BoxTracks
    observed: Observations
    when_seen: GaussianStates


class OcSort:
    """Kalman filters of boxes with observation-centric momentum, recovery and re-update."""

    def __init__(self, options: OcSortOptions, setting: TrackerSetting) -> None:
        self._options, self._sensor, self._in_plane = options, setting.sensor, is_in_plane(setting)
        self._times_s: list[float] = []
        self._next_track_id = 1
        nobody = none_begun(options)
        self._tracks = OcTracks(nobody, Observations.first(0.0, nobody.middle_m), nobody.states)

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return the tracks; see ``Tracker``."""
        options, detections = self._options, scan.detections
        tracks = self._predicted(scan)
        index, detection = _matched(tracks, detections, options)
        tracks = _updated(tracks, index, detections, detection, self._times_s, options)
        others = np.setdiff1d(np.flatnonzero(_sure(detections, options)), detection)
        lives = Lives.begun(self._next_track_id, len(others), scan.time_s)
        self._next_track_id += len(others)
        new = begun(lives, taken(detections, others), scan.ego, options)
        first = OcTracks(new, Observations.first(scan.time_s, new.middle_m), new.states)
        self._tracks = joined(tracks, first)
        boxes = self._tracks.boxes
        return reported(boxes.lives, boxes.states, scan.time_s, options)

    def _predicted(self, scan: Scan) -> OcTracks:
        """Return the tracks at the time of a scan, and remember its time as long as some track is unseen."""
        boxes = self._tracks.boxes
        if self._times_s:
            boxes = predicted(boxes, scan.time_s - self._times_s[-1], self._options, self._in_plane)
        kept = remembered(boxes.lives, boxes.states, scan, self._sensor.range_m, self._options)
        tracks = taken(replace(self._tracks, boxes=boxes), kept)
        earliest_s = np.min(tracks.boxes.lives.last_seen_s, initial=scan.time_s)
        self._times_s = [time_s for time_s in (*self._times_s, scan.time_s) if time_s >= earliest_s]
        return tracks


build_oc_sort = factory(OcSortOptions, OcSort)


def _matched(tracks: OcTracks, detections: Detections, options: OcSortOptions) -> tuple[IntArray, IntArray]:
    """Return pairs of tracks and detections: by the predicted boxes, then by the last seen ones of what is left."""
    overlap = overlaps(tracks.boxes, tracks.boxes.middle_m, detections, options)
    gain = overlap - options.least_overlap + options.momentum_weight * momentum(tracks.observed, detections, options)
    near, sure = overlap >= options.least_overlap, _sure(detections, options)
    first = _best(gain, near & sure)
    overlap = overlaps(tracks.boxes, tracks.observed.last_m, detections, options)
    allowed = (overlap >= options.recovery_overlap) & (options.recovery_overlap < 1.0) & sure
    allowed[first[0]] = allowed[:, first[1]] = False
    second = _best(overlap - options.recovery_overlap, allowed)
    near &= ~sure
    near[first[0]] = near[second[0]] = False
    rounds = first, second, _best(gain, near)
    return np.concatenate([pairs[0] for pairs in rounds]), np.concatenate([pairs[1] for pairs in rounds])


def _sure(detections: Detections, options: OcSortOptions) -> BoolArray:
    """Return which detections are sure enough to start a track, shape (d,); all of a detector without scores."""
    score = detections.score
    return np.ones(len(detections), dtype=np.bool_) if score is None else score >= options.sure_score


def _best(gain: FloatArray, allowed: BoolArray) -> tuple[IntArray, IntArray]:
    return best_pairs(gain + 1e-9, allowed)


def momentum(observed: Observations, detections: Detections, options: OcSortOptions) -> FloatArray:
    """Return how far each detection lies the way that each track went, 0 (opposite) to 1, shape (n, d).

    Both directions begin at the observation ``momentum_s`` before the last one; where one of them means nothing, the
    value is that of a right angle.
    """
    start_m = observed.before_m(options.momentum_s)
    went_m = (observed.last_m - start_m)[:, None]
    places_m = np.column_stack([detections.lon_m, detections.lat_m])
    goes_m = places_m - start_m[:, None]
    turn = wrapped(np.arctan2(goes_m[..., 1], goes_m[..., 0]) - np.arctan2(went_m[..., 1], went_m[..., 0]))
    is_told = (_length(went_m) >= _LEAST_MOTION_M) & (_length(goes_m) >= _LEAST_MOTION_M)
    return np.asarray(np.where(is_told, 1.0 - np.abs(turn) / np.pi, 0.5))


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.hypot(vectors[..., 0], vectors[..., 1]))


def _updated(
    tracks: OcTracks,
    index: IntArray,
    detections: Detections,
    detection: IntArray,
    times_s: list[float],
    options: OcSortOptions,
) -> OcTracks:
    """Return the predicted tracks after a detection each of some; times of scans since the first last look."""
    places_m = np.column_stack([detections.lon_m, detections.lat_m])[detection]
    boxes = tracks.boxes
    if options.reupdate:
        std_m = np.column_stack([detections.std_lon_m, detections.std_lat_m])[detection]
        boxes = replace(boxes, states=_seen_all_along(tracks, index, places_m, std_m, times_s, options))
    boxes = taken_in(boxes, index, detections, detection, times_s[-1])
    when_seen = _put(tracks.when_seen, index, taken(boxes.states, index))
    return OcTracks(boxes, tracks.observed.followed(index, times_s[-1], places_m), when_seen)


def _seen_all_along(
    tracks: OcTracks,
    index: IntArray,
    places_m: FloatArray,
    std_m: FloatArray,
    times_s: list[float],
    options: OcSortOptions,
) -> GaussianStates:
    """Return the predicted states as if who is found now had been seen on a straight way all the while."""
    since_s, now_s = tracks.boxes.lives.last_seen_s[index], times_s[-1]
    from_m = tracks.observed.last_m[index]
    way_m = places_m - from_m
    states = taken(tracks.when_seen, index)
    earliest_s = np.min(since_s, initial=now_s)
    for before_s, time_s in pairwise(time_s for time_s in times_s if time_s >= earliest_s):
        unseen = np.flatnonzero(since_s <= before_s)
        moved = predict_constant_velocity(
            taken(states, unseen), time_s - before_s, options.lon_noise, options.lat_noise
        )
        states = _put(states, unseen, moved)
        if time_s < now_s:
            share = (time_s - since_s[unseen]) / (now_s - since_s[unseen])
            imagined_m = from_m[unseen] + share[:, None] * way_m[unseen]
            for variable, column in ((LON, 0), (LAT, 1)):
                states = update_variable(states, unseen, variable, imagined_m[:, column], std_m[unseen, column])
    return _put(tracks.boxes.states, index, states)


def _put(states: GaussianStates, index: IntArray, others: GaussianStates) -> GaussianStates:
    """Return beliefs of which some, shape (k,), are replaced by k others."""
    mean, covariance = states.mean.copy(), states.covariance.copy()
    mean[index], covariance[index] = others.mean, others.covariance
    return GaussianStates(mean, covariance)
