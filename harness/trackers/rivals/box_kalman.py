"""Tracking by detection as automated driving does it: a Kalman filter of each box, matched by overlap.

Written after AB3DMOT (Weng, Wang, Held and Kitani, IROS 2020) and SimpleTrack (Pang, Li and Wang, 2021): a box's
middle moves at a nearly constant velocity, its size and direction hardly change, and each scan's boxes are assigned to
the predicted ones by their generalised overlap from above. Confirmed tracks choose first, unconfirmed ones among what
is left; the scans of this project carry no scores by which detections could take turns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from harness.trackers.kalman import (
    LAT,
    LAT_SPEED,
    LON,
    SPEED,
    GaussianStates,
    newborn,
    predict_constant_velocity,
    updated,
)
from harness.trackers.plane import PlaneTracker, is_in_plane
from harness.trackers.protocol import Tracker, TrackerSetting, trackers
from harness.trackers.rivals.boxes import FlatBoxes, generalised_overlap
from harness.trackers.rivals.gaussian import best_pairs, in_order, pairs_of, scaled
from harness.trackers.rivals.lives import Lives, Moment, remembered, reported
from harness.trackers.rivals.options import RivalOptions, in_frame
from mmpf.compute.arrays import BoolArray, FloatArray, IntArray, joined, taken, wrapped
from mmpf.options import Footprint
from mmpf.scan import Detections, EgoPose, Scan, SensorModel, check_scan
from mmpf.settings import NotNegative, Positive, in_unit
from mmpf.tracks import Tracks

# Boxes whose middles are farther apart are not compared: even two lorries of which one stands before the other.
_COMPARED_WITHIN_M = 25.0
_TURNING_MPS = 1.0
_UNKNOWN_HEADING_STD_RAD = 1.0


class BoxKalmanOptions(RivalOptions):
    """Settings of the tracker of boxes."""

    association: Literal["overlap", "mahalanobis"] = "overlap"
    """What says which detection is nearest to a track: the generalised overlap of their boxes from above, or the
    distance of their middles in standard deviations.
    """
    least_overlap: Annotated[float, Field(ge=-1.0, lt=1.0), in_unit("overlap")] = -0.4
    """A detection counts for a track from this generalised overlap on, -1 to 1; boxes that just touch have about 0."""
    size_noise: Annotated[NotNegative, in_unit("m²/s")] = 0.01
    """Power spectral density of the changes of a box's size."""
    heading_noise: Annotated[NotNegative, in_unit("rad²/s")] = 0.05
    """Power spectral density of the changes of a box's direction, where directions are measured."""
    vehicle: Footprint = Footprint()
    """Size of a vehicle before it is measured."""
    longest_unseen_s: Positive = 3.0
    """A confirmed track ends when unseen for longer; AB3DMOT's own is 0.2 s."""


@dataclass(frozen=True)
class BoxTracks:
    """The boxes that are followed, n of them.

    Attributes:
        lives: What is counted of each.
        states: Middles and velocities.
        size_m: Mean lengths and widths, shape (n, 2).
        size_variance_m2: Their variances, shape (n, 2).
        heading_rad: Mean directions, shape (n,).
        heading_variance: Their variances, shape (n,).
    """

    lives: Lives
    states: GaussianStates
    size_m: FloatArray
    size_variance_m2: FloatArray
    heading_rad: FloatArray
    heading_variance: FloatArray


class BoxKalman:
    """A Kalman filter of each vehicle's box, matched to detections by generalised overlap."""

    def __init__(self, options: BoxKalmanOptions, sensor: SensorModel, in_plane: bool = False) -> None:
        self._options, self._sensor, self._in_plane = options, sensor, in_plane
        self._time_s: float | None = None
        self._next_track_id = 1
        nobody = EgoPose(0.0, 0.0, 0.0, 0.0, 1.0, 1.0)
        self._tracks = _begun(Lives.begun(1, 0, 0.0), _no_detections(), nobody, options)

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return the tracks.

        Raises:
            InvalidScanError: See ``mmpf.scan.check_scan``.
        """
        check_scan(scan, self._time_s)
        options = self._options
        detections = scaled(in_order(scan.detections), options.noise_factor)
        if self._time_s is not None:
            self._tracks = _predicted(self._tracks, scan.time_s - self._time_s, options, self._in_plane)
        self._time_s = scan.time_s
        tracks = self._tracks
        states = tracks.states.mean
        moment = Moment(scan.time_s, scan.ego, self._sensor.range_m)
        tracks = taken(tracks, remembered(tracks.lives, states[:, LON], states[:, LAT], moment, options))
        index, detection = _matched(tracks, detections, options)
        tracks = _updated(tracks, index, detections, detection, scan.time_s)
        others = np.setdiff1d(np.arange(len(detections)), detection)
        lives = Lives.begun(self._next_track_id, len(others), scan.time_s)
        begun = _begun(lives, taken(detections, others), scan.ego, options)
        self._next_track_id += len(others)
        self._tracks = joined(tracks, begun)
        return reported(
            self._tracks.lives, self._tracks.states.mean, self._tracks.states.covariance, scan.time_s, options
        )


@trackers.register("box-kalman")
def build_box_kalman(setting: TrackerSetting, options: Mapping[str, object]) -> Tracker:
    """Build the tracker of boxes."""
    chosen = in_frame(BoxKalmanOptions.model_validate(dict(options)), setting)
    in_plane = is_in_plane(setting)
    tracker = BoxKalman(chosen, setting.sensor, in_plane)
    return PlaneTracker(tracker) if in_plane else tracker


def _predicted(tracks: BoxTracks, interval_s: float, options: BoxKalmanOptions, in_plane: bool) -> BoxTracks:
    states = predict_constant_velocity(tracks.states, interval_s, options.lon_noise, options.lat_noise)
    heading, variance = tracks.heading_rad, tracks.heading_variance + options.heading_noise * interval_s
    if in_plane:
        # Where no direction was ever measured, boxes point where they go.
        speed = np.hypot(states.mean[:, SPEED], states.mean[:, LAT_SPEED])
        moves = (speed > _TURNING_MPS) & (tracks.heading_variance >= _UNKNOWN_HEADING_STD_RAD**2)
        heading = np.where(moves, np.arctan2(states.mean[:, LAT_SPEED], states.mean[:, SPEED]), heading)
    return replace(
        tracks,
        states=states,
        size_variance_m2=tracks.size_variance_m2 + options.size_noise * interval_s,
        heading_rad=heading,
        heading_variance=variance,
    )


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
    """Return what it is worth to match each track with each detection, and whether it may be, shape (n, d)."""
    mean = tracks.states.mean
    if options.association == "mahalanobis":
        squared = pairs_of(mean, tracks.states.covariance, detections).squared_distance
        return options.gate_std**2 - squared, squared <= options.gate_std**2
    away_m = np.hypot(detections.lon_m - mean[:, LON, None], detections.lat_m - mean[:, LAT, None])
    track, detection = np.nonzero(away_m <= _COMPARED_WITHIN_M)
    size_m, heading = tracks.size_m[track], tracks.heading_rad[track]
    predicted = FlatBoxes(mean[track, LON], mean[track, LAT], size_m[:, 0], size_m[:, 1], heading)
    found_size = _measured_sizes(detections, options)[0][detection]
    found_heading = heading if detections.headings is None else detections.headings.heading_rad[detection]
    found = FlatBoxes(
        detections.lon_m[detection], detections.lat_m[detection], found_size[:, 0], found_size[:, 1], found_heading
    )
    overlap = np.full(away_m.shape, -1.0)
    overlap[track, detection] = generalised_overlap(predicted, found)
    return overlap - options.least_overlap + 1e-9, overlap >= options.least_overlap


def _updated(
    tracks: BoxTracks, index: IntArray, detections: Detections, detection: IntArray, time_s: float
) -> BoxTracks:
    states = updated(tracks.states, index, detections, detection)
    size_m, size_variance = tracks.size_m.copy(), tracks.size_variance_m2.copy()
    heading, heading_variance = tracks.heading_rad.copy(), tracks.heading_variance.copy()
    if detections.sizes is not None:
        sizes = detections.sizes.take(detection)
        measured = np.column_stack([sizes.length_m, sizes.width_m])
        noise = np.column_stack([sizes.std_length_m, sizes.std_width_m]) ** 2
        gain = size_variance[index] / (size_variance[index] + noise)
        size_m[index] += gain * (measured - size_m[index])
        size_variance[index] *= 1.0 - gain
    if detections.headings is not None:
        headings = detections.headings.take(detection)
        off = wrapped(headings.heading_rad - heading[index])
        # A front taken for a back: what is measured then turns round (AB3DMOT's orientation correction).
        off = np.where(np.abs(off) > 0.5 * np.pi, wrapped(off + np.pi), off)
        gain = heading_variance[index] / (heading_variance[index] + headings.std_rad**2)
        heading[index] = wrapped(heading[index] + gain * off)
        heading_variance[index] *= 1.0 - gain
    return BoxTracks(tracks.lives.seen(index, time_s), states, size_m, size_variance, heading, heading_variance)


def _begun(lives: Lives, detections: Detections, ego: EgoPose, options: BoxKalmanOptions) -> BoxTracks:
    """Return a new track at each detection."""
    count = len(detections)
    size_m, size_std_m = _measured_sizes(detections, options)
    headings = detections.headings
    heading = np.zeros(count) if headings is None else headings.heading_rad
    unknown = np.full(count, _UNKNOWN_HEADING_STD_RAD)
    return BoxTracks(
        lives,
        newborn(detections, np.arange(count), ego, options),
        size_m,
        size_std_m**2,
        heading.copy(),
        (unknown if headings is None else headings.std_rad) ** 2,
    )


def _measured_sizes(detections: Detections, options: BoxKalmanOptions) -> tuple[FloatArray, FloatArray]:
    """Return lengths and widths of detections and their deviations, each of shape (d, 2)."""
    sizes, usual = detections.sizes, options.vehicle
    if sizes is None:
        ones = np.ones((len(detections), 1))
        return ones * [usual.length_m, usual.width_m], ones * [usual.std_length_m, usual.std_width_m]
    return (
        np.column_stack([sizes.length_m, sizes.width_m]),
        np.column_stack([sizes.std_length_m, sizes.std_width_m]),
    )


def _no_detections() -> Detections:
    none = np.zeros(0)
    return Detections(none, none, none, none, none, none)
