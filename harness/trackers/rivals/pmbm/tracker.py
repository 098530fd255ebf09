"""The PMBM filter as a tracker: sensor model, births, occlusion and reports.

Vehicles that were never detected are spread evenly over what the sensor covers, at a density that is in balance between
newcomers and detections. With ``shadow_aware`` the detection probability of each single hypothesis is that where it may
be behind the other tracks' shadows, as in OptiPMB (arXiv 2503.12968), so that a hidden vehicle goes on existing.
Nothing of that is told by the truth: bodies and shadows are those of the tracks.
"""

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from harness.trackers.kalman import LAT, LAT_SPEED, LON, SPEED, newborn, predict_constant_velocity
from harness.trackers.plane import is_in_plane
from harness.trackers.protocol import TrackerSetting
from harness.trackers.rivals.lives import TIME_TOLERANCE_S, Lives, remembered, reported
from harness.trackers.rivals.pmbm.clusters import Pruning
from harness.trackers.rivals.pmbm.mixture import (
    HypothesisMixture,
    MeasuredHypotheses,
    nothing,
    survived,
    updated_mixture,
    without,
)
from harness.trackers.track_options import ExistenceOptions, factory
from mmpf.map.sensor_plane import SensorPlane
from mmpf.numerics.arrays import FloatArray, taken
from mmpf.options.base import Positive, Probability
from mmpf.options.filter import Footprint
from mmpf.scan import Detections, Scan
from mmpf.tracks import Tracks
from mmpf.visibility.depth import Occluders, depth_table
from mmpf.visibility.shadows import visible_fractions

_SLOW_MPS = 1.0
_LEAST_OF_NEWCOMERS = 0.1

# A track with a detection within this time casts a shadow.
_OCCLUDER_UNSEEN_S = 1.0
_MOST, _LEAST_WEIGHT = 10, 0.01
# Five points that stand for a Gaussian, in standard deviations, and what they weigh.
_POINTS, _WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
_WEIGHTS = _WEIGHTS / _WEIGHTS.sum()


class PmbmOptions(ExistenceOptions):
    """Settings of the PMBM tracker."""

    gate_std: Positive = 4.5
    """A detection counts for a hypothesis within this many standard deviations."""
    score_weight: Probability = 0.0
    """Exponent of the odds that a detection's score gives; 0 ignores scores."""
    newcomer_share: Positive = 0.1
    """Expected detections of vehicles never detected before, relative to clutter."""
    shadow_aware: bool = True
    """Whether a hypothesis behind another track's shadow is less likely to be detected."""
    hidden_probability: Probability = 0.02
    """Detection probability of a vehicle in the shadows of other tracks."""
    vehicle: Footprint = Footprint()
    """Size of a vehicle where sizes are not measured."""
    longest_unseen_s: Positive = 10.0
    """A confirmed hypothesis without detections for longer ends."""
    alike_scans: Annotated[int, Field(ge=0, le=100)] = 5
    """Global hypotheses with identical assignments over this many scans are merged; 0 merges none.
    """


class Pmbm:
    """Poisson multi-Bernoulli mixture filter with tracks."""

    def __init__(self, options: PmbmOptions, setting: TrackerSetting) -> None:
        self._options, self._sensor, self._road = options, setting.sensor, setting.road
        self._in_plane = is_in_plane(setting)
        chosen = options.detection_probability
        self._in_view = setting.sensor.detection_probability if chosen is None else chosen
        newcomer_exists = options.newcomer_share / (1.0 + options.newcomer_share)
        least_existence = min(options.least_existence, _LEAST_OF_NEWCOMERS * newcomer_exists)
        self._pruning = Pruning(options.gate_std, _MOST, _LEAST_WEIGHT, least_existence, options.alike_scans)
        self._time_s: float | None = None
        self._next_track_id = 1
        self._mixture = nothing(options.alike_scans)

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return the tracks; see ``Tracker``."""
        mixture = self._predicted(scan)
        self._time_s = scan.time_s
        self._mixture = updated_mixture(mixture, self._measured(scan, mixture), self._pruning)
        return self._report(scan.time_s)

    def _predicted(self, scan: Scan) -> HypothesisMixture:
        options, mixture = self._options, self._mixture
        if self._time_s is None:
            return mixture
        interval_s = scan.time_s - self._time_s
        states = predict_constant_velocity(mixture.singles.states, interval_s, options.lon_noise, options.lat_noise)
        mixture = replace(mixture, singles=replace(mixture.singles, states=states))
        goes_on = remembered(mixture.singles.lives, states, scan, self._sensor.range_m, options)
        mixture = mixture if goes_on.all() else without(mixture, ~goes_on)
        return survived(mixture, float(np.exp(-interval_s / options.stay_s)))

    def _measured(self, scan: Scan, mixture: HypothesisMixture) -> MeasuredHypotheses:
        options, detections, count = self._options, scan.detections, len(scan.detections)
        clutter = options.clutter_factor * self._sensor.clutter_density_per_m2
        lives = Lives.begun(self._next_track_id, count, scan.time_s)
        self._next_track_id += count
        return MeasuredHypotheses(
            time_s=scan.time_s,
            detections=detections,
            sizes_m=self._sizes(detections),
            seen=self._seen(scan, mixture),
            clutter_density=clutter / detections.odds**options.score_weight,
            newcomers=np.full(count, options.newcomer_share * clutter),
            first=(lives, newborn(detections, np.arange(count), scan.ego, options)),
        )

    def _sizes(self, detections: Detections) -> FloatArray:
        sizes = detections.sizes
        if sizes is None:
            return np.tile([self._options.vehicle.length_m, self._options.vehicle.width_m], (len(detections), 1))
        return np.column_stack([sizes.length_m, sizes.width_m])

    def _seen(self, scan: Scan, mixture: HypothesisMixture) -> FloatArray:
        """Return the detection probability of each single hypothesis, a mean over where it may be, shape (h,)."""
        singles, best, sensor = mixture.singles, mixture.best, self._sensor
        if not self._options.shadow_aware or not len(best):
            return np.full(len(singles.existence), self._in_view)
        mean = singles.states.mean
        # A hypothesis is not in the shadow of its own track; one that is in no best hypothesis casts none itself.
        others, first = np.unique(singles.lives.track_id, return_index=True)
        bodiless = first[~np.isin(others, singles.lives.track_id[best])]
        likely = singles.existence[best] >= self._options.reported_existence
        recent = scan.time_s - singles.lives.last_seen_s[best] <= _OCCLUDER_UNSEEN_S + TIME_TOLERANCE_S
        casts_shadow = np.concatenate([recent & likely, np.zeros(len(bodiless), dtype=np.bool_)])
        best = np.concatenate([best, bodiless])
        bodies = Occluders(singles.size_m[best, 0], singles.size_m[best, 1], self._turn(mean[best]))
        plane = SensorPlane(scan.ego, self._road)
        table = depth_table(plane, mean[best, LON], mean[best, LAT], casts_shadow, bodies)
        caster_of = dict(zip(singles.lives.track_id[best].tolist(), range(len(best)), strict=True))
        component = np.array([caster_of[number] for number in singles.lives.track_id.tolist()], dtype=np.int64)
        along = _widest(singles.states.covariance)
        lon, lat = ((mean[:, row, None] + along[:, k, None] * _POINTS).ravel() for k, row in enumerate((LON, LAT)))
        visible = visible_fractions(plane, lon, lat, np.repeat(component, len(_POINTS)), bodies, table)
        share = np.clip(visible / max(sensor.full_view_fraction, 1e-6), 0.0, 1.0)
        can_be_seen = (visible >= sensor.hidden_fraction) & (plane.distance_m(lon, lat) <= sensor.range_m)
        probability = np.maximum(np.where(can_be_seen, self._in_view * share, 0.0), self._options.hidden_probability)
        return np.asarray(probability.reshape(-1, len(_POINTS)) @ _WEIGHTS, dtype=np.float64)

    def _turn(self, mean: FloatArray) -> FloatArray | None:
        """Return where vehicles point in the plane, shape (m,); None along the road."""
        if not self._in_plane:
            return None
        moves = np.hypot(mean[:, SPEED], mean[:, LAT_SPEED]) > _SLOW_MPS
        return np.where(moves, np.arctan2(mean[:, LAT_SPEED], mean[:, SPEED]), 0.0)

    def _report(self, time_s: float) -> Tracks:
        best = self._mixture.best
        best = best[self._mixture.singles.existence[best] >= self._options.reported_existence]
        shown = taken(self._mixture.singles, best[np.argsort(self._mixture.singles.lives.track_id[best])])
        return reported(shown.lives, shown.states, time_s, self._options, shown.existence)


build_pmbm = factory(PmbmOptions, Pmbm)


def _widest(covariance: FloatArray) -> FloatArray:
    """Return the standard deviation of places along the direction in which it is greatest, as vectors, shape (h, 2)."""
    lon, lat, both = covariance[:, LON, LON], covariance[:, LAT, LAT], covariance[:, LON, LAT]
    angle = 0.5 * np.arctan2(2.0 * both, lon - lat)
    variance = 0.5 * (lon + lat) + np.hypot(0.5 * (lon - lat), both)
    direction = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0))[:, None] * direction)
