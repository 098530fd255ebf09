"""The labelled multi-Bernoulli filter of multisensor-lmb-filters-rs, which others wrote.

The package predicts, associates by belief propagation, updates, merges and prunes (Reuter, Vo, Vo and Dietmayer, IEEE
TSP 2014; Robertson et al., Signal Processing 2022). Here are its models for each scan, and the birth from measurements:
a vehicle may begin at each detection of the scan before that no track claimed. The package's noise and detection
probability are one for all, so the noise is the mean of what a scan's detections report.
"""

from __future__ import annotations

from typing import Any

import multisensor_lmb_filters_rs as lmb
import numpy as np

from harness.trackers.kalman import LAT, LON, GaussianStates, newborn, predict_constant_velocity
from harness.trackers.protocol import TrackerSetting
from harness.trackers.rivals.lives import Lives, remembered, reported
from harness.trackers.rivals.lmb.options import LmbOptions
from harness.trackers.track_options import factory
from mmpf.numerics.arrays import joined, taken
from mmpf.scan import Detections, Scan
from mmpf.tracks import Tracks

_CLAIMED = 0.5
# Gaussian components kept for each track.
MOST_COMPONENTS = 5


class Lmb:
    """The package's filter, built anew for each scan from what it believed at the last one."""

    def __init__(self, options: LmbOptions, setting: TrackerSetting) -> None:
        self._options, self._sensor = options, setting.sensor
        self._time_s: float | None = None
        self._scans = 0
        self._next_track_id = 1
        self._tracks: list[Any] = []
        self._lives = Lives.begun(1, 0, 0.0)
        self._births = GaussianStates(np.zeros((0, 4)), np.zeros((0, 4, 4)))

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return the tracks; see ``Tracker``."""
        detections = scan.detections
        before_s = scan.time_s if self._time_s is None else self._time_s
        self._time_s, self._scans = scan.time_s, self._scans + 1
        made, births = self._filter(detections, scan.time_s - before_s), len(self._births.mean)
        made.set_tracks(self._tracks)
        found = made.step_detailed(list(np.column_stack([detections.lon_m, detections.lat_m])), self._scans)
        claims = np.zeros((len(found.predicted_tracks), len(detections)))
        if found.association_result is not None:
            claims = np.asarray(found.association_result.marginal_weights).reshape(claims.shape)
        # A new track has had the detection that it began at.
        lives = joined(self._lives, Lives.begun(self._next_track_id, births, before_s))
        self._next_track_id += births
        labels = [*(track.label for track in self._tracks), *((self._scans, k) for k in range(births))]
        row_of = {label: row for row, label in enumerate(labels)}
        rows = np.array([row_of[track.label] for track in found.predicted_tracks], dtype=np.int64)
        lives = lives.seen(rows[claims.sum(axis=1) > _CLAIMED], scan.time_s)
        self._births = newborn(detections, np.flatnonzero(claims.sum(axis=0) < _CLAIMED), scan.ego, self._options)
        self._tracks = made.get_tracks()
        self._lives = taken(lives, np.array([row_of[track.label] for track in self._tracks], dtype=np.int64))
        return self._report(scan)

    def _filter(self, detections: Detections, interval_s: float) -> Any:  # noqa: ANN401
        """Return the package's filter with the models of this scan."""
        options, sheet = self._options, self._sensor
        still = GaussianStates(np.eye(4), np.zeros((4, 4, 4)))
        moved = predict_constant_velocity(still, interval_s, options.lon_noise, options.lat_noise)
        stays = float(np.exp(-interval_s / options.stay_s))
        motion = lmb.MotionModel(moved.mean.T.copy(), moved.covariance[0], np.zeros(4), stays)
        noise_m2 = detections.covariance_m2.mean(axis=0) if len(detections) else np.eye(2)
        chosen = options.detection_probability
        sensor = lmb.SensorModel(
            np.eye(4)[[LON, LAT]],
            noise_m2,
            sheet.detection_probability if chosen is None else chosen,
            options.clutter_factor * max(sheet.clutter_per_scan, 1e-3),
            sheet.clutter_area_m2,
        )
        begun = predict_constant_velocity(self._births, interval_s, options.lon_noise, options.lat_noise)
        places = [lmb.BirthLocation(k, *each) for k, each in enumerate(zip(begun.mean, begun.covariance, strict=True))]
        birth = lmb.BirthModel(places, options.birth_existence, options.birth_existence)
        limits = lmb.FilterThresholds(options.least_existence, 1e-3, MOST_COMPONENTS)
        return lmb.FilterLmb(motion, sensor, birth, lmb.AssociatorConfig.lbp(), limits)

    def _report(self, scan: Scan) -> Tracks:
        """End tracks that are lost, and return those of the others that are likely to exist."""
        states, options = _moments(self._tracks), self._options
        kept = remembered(self._lives, states, scan, self._sensor.range_m, options)
        self._tracks = [track for track, stays in zip(self._tracks, kept.tolist(), strict=True) if stays]
        self._lives, states = taken(self._lives, kept), taken(states, kept)
        existence = np.array([track.existence for track in self._tracks])
        shown = np.flatnonzero(existence >= options.reported_existence)
        shown = shown[np.argsort(self._lives.track_id[shown])]
        lives, states = taken(self._lives, shown), taken(states, shown)
        return reported(lives, states, scan.time_s, options, existence[shown])


def _moments(tracks: list[Any]) -> GaussianStates:
    """Return mean and covariance of each track's mixture of Gaussians."""
    mean, covariance = np.zeros((len(tracks), 4)), np.zeros((len(tracks), 4, 4))
    for k, track in enumerate(tracks):
        weight, means = np.asarray(track.w) / np.sum(track.w), np.asarray(track.mu)
        mean[k] = weight @ means
        off = means - mean[k]
        covariance[k] = np.tensordot(weight, np.asarray(track.sigma) + off[:, :, None] * off[:, None, :], axes=1)
    return GaussianStates(mean, covariance)


build_lmb = factory(LmbOptions, Lmb)
