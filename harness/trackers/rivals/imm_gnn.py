"""Interacting models with global nearest neighbour association: vehicles that go on, and vehicles that manoeuvre.

Detections are assigned to tracks so that the sum of the log-likelihood ratios is greatest: that a detection is the
track's against that it is clutter or somebody new (Blackman and Popoli 1999, chapter 6).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np

from harness.trackers.doubtful import as_reported
from harness.trackers.kalman import LAT, LON, newborn
from harness.trackers.protocol import Tracker, TrackerSetting
from harness.trackers.rivals.gaussian import best_pairs, in_order, pairs_of, scaled
from harness.trackers.rivals.imm import (
    ACCEL,
    MODELS,
    STATE_SIZE,
    TURN,
    Manoeuvres,
    ModelBeliefs,
    combined,
    mixed,
    predicted,
    stays,
    updated,
)
from harness.trackers.rivals.lives import Lives, Moment, remembered, reported
from harness.trackers.rivals.options import RivalOptions, in_frame
from mmpf.numerics.arrays import FloatArray, IntArray, joined, taken
from mmpf.options.base import Positive, Probability, in_unit
from mmpf.scan import Detections, EgoPose, Scan, SensorModel, check_scan
from mmpf.tracks import Tracks


class ImmGnnOptions(RivalOptions):
    """Settings of the tracker of interacting models."""

    gate_std: Positive = 5.0
    """A detection counts for a track within this many standard deviations."""
    detection_probability: Probability | None = None
    """Detection probability used in association; None takes the sensor's."""
    clutter_factor: Positive = 1.0
    """Density of clutter and new vehicles used in association, relative to the data sheet's clutter."""
    accel_std_mps2: Positive = 1.5
    """Standard deviation of the acceleration of a manoeuvring vehicle."""
    turn_std_rad_per_s: Annotated[Positive, in_unit("rad/s")] = 0.1
    """Standard deviation of the turn rate of a manoeuvring vehicle."""
    fade_s: Positive = 2.0
    """Time constant with which acceleration and turn rate decay."""
    steady_s: Positive = 10.0
    """Mean time for which a vehicle keeps its velocity."""
    manoeuvre_s: Positive = 3.0
    """Mean time for which a vehicle manoeuvres."""


@dataclass(frozen=True)
class _Followed:
    """The vehicles that are followed, n of them."""

    lives: Lives
    beliefs: ModelBeliefs


class ImmGnn:
    """Interacting CV and CTRA models of each vehicle, with global nearest neighbour association."""

    def __init__(self, options: ImmGnnOptions, sensor: SensorModel) -> None:
        self._options, self._sensor = options, sensor
        self._manoeuvres = Manoeuvres(
            options.lon_noise, options.lat_noise, options.accel_std_mps2, options.turn_std_rad_per_s, options.fade_s
        )
        self._time_s: float | None = None
        self._next_track_id = 1
        none = ModelBeliefs(
            np.zeros((0, MODELS, STATE_SIZE)), np.zeros((0, MODELS, STATE_SIZE, STATE_SIZE)), np.zeros((0, MODELS))
        )
        self._followed = _Followed(Lives.begun(1, 0, 0.0), none)

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return the tracks.

        Raises:
            InvalidScanError: See ``mmpf.scan.check_scan``.
        """
        check_scan(scan, self._time_s)
        detections = scaled(in_order(scan.detections), self._options.noise_factor)
        followed = self._predicted(scan)
        self._time_s = scan.time_s
        mean, covariance = combined(followed.beliefs)
        index, detection = self._matched(mean, covariance, detections)
        followed = replace(
            followed,
            lives=followed.lives.seen(index, scan.time_s),
            beliefs=updated(followed.beliefs, index, detections, detection),
        )
        others = np.setdiff1d(np.arange(len(detections)), detection)
        lives = Lives.begun(self._next_track_id, len(others), scan.time_s)
        self._next_track_id += len(others)
        self._followed = joined(followed, _Followed(lives, self._newborn(detections, others, scan.ego)))
        mean, covariance = combined(self._followed.beliefs)
        tracks = reported(self._followed.lives, mean, covariance, scan.time_s, self._options)
        return replace(tracks, accel_mps2=mean[:, ACCEL])

    def _predicted(self, scan: Scan) -> _Followed:
        if self._time_s is None:
            return self._followed
        options, interval_s = self._options, scan.time_s - self._time_s
        before = mixed(self._followed.beliefs, stays(interval_s, (options.steady_s, options.manoeuvre_s)))
        beliefs = predicted(before, interval_s, self._manoeuvres)
        mean, _ = combined(beliefs)
        moment = Moment(scan.time_s, scan.ego, self._sensor.range_m)
        followed = _Followed(self._followed.lives, beliefs)
        return taken(followed, remembered(followed.lives, mean[:, LON], mean[:, LAT], moment, options))

    def _matched(self, mean: FloatArray, covariance: FloatArray, detections: Detections) -> tuple[IntArray, IntArray]:
        options, sensor = self._options, self._sensor
        pairs = pairs_of(mean, covariance, detections)
        chosen = options.detection_probability
        seen = np.clip(sensor.detection_probability if chosen is None else chosen, 1e-3, 1.0 - 1e-3)
        others = options.clutter_factor * sensor.clutter_density_per_m2
        gain = np.log(seen / (1.0 - seen) / others) + pairs.log_density
        return best_pairs(gain, pairs.squared_distance <= options.gate_std**2)

    def _newborn(self, detections: Detections, index: IntArray, ego: EgoPose) -> ModelBeliefs:
        options = self._options
        first = newborn(detections, index, ego, options)
        mean = np.zeros((len(index), MODELS, STATE_SIZE))
        covariance = np.zeros((len(index), MODELS, STATE_SIZE, STATE_SIZE))
        mean[:, :, :4] = first.mean[:, None]
        covariance[:, :, :4, :4] = first.covariance[:, None]
        covariance[:, :, [ACCEL, TURN], [ACCEL, TURN]] = self._manoeuvres.prior_variance
        shares = np.array([options.steady_s, options.manoeuvre_s]) / (options.steady_s + options.manoeuvre_s)
        return ModelBeliefs(mean, covariance, np.tile(shares, (len(index), 1)))


def build_imm_gnn(setting: TrackerSetting, options: Mapping[str, object]) -> Tracker:
    """Build the tracker of interacting models."""
    chosen = in_frame(ImmGnnOptions.model_validate(dict(options)), setting)
    return as_reported(ImmGnn(chosen, setting.sensor), setting, chosen.doubtful)
