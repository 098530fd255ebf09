"""Stone Soup's multi-target trackers behind this project's tracker role.

Each is put together from Stone Soup's own parts as its tutorials do: a nearly-constant-velocity or -acceleration model
in the road frame, each detection with its own noise, tracks initiated after several detections and deleted when unseen
for long or spread wide. Stone Soup's tracks carry no existence probability (1 is reported) and no flag for "can't be
seen"; a track without an update for ``hidden_after_s`` is reported as hidden, so that the rule that coasting tracks
are not false in sight holds for them as well. Tracks that are still held by the initiator are not reported.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from datetime import timedelta
from typing import Annotated, Literal

import numpy as np
from ordered_set import OrderedSet
from pydantic import Field
from scipy.stats import chi2
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDAwithEHM2
from stonesoup.deleter.error import CovarianceBasedDeleter
from stonesoup.deleter.multi import CompositeDeleter
from stonesoup.deleter.time import UpdateTimeDeleter
from stonesoup.hypothesiser.base import Hypothesiser
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.initiator.simple import GaussianParticleInitiator
from stonesoup.measures import Mahalanobis
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantAcceleration,
    ConstantVelocity,
)
from stonesoup.predictor import Predictor
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.predictor.particle import ParticlePredictor
from stonesoup.resampler.particle import ESSResampler
from stonesoup.tracker.simple import MultiTargetMixtureTracker, MultiTargetTracker
from stonesoup.types.array import StateVector
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.updater import Updater
from stonesoup.updater.kalman import KalmanUpdater
from stonesoup.updater.particle import ParticleUpdater

from harness.trackers.protocol import TrackerSetting, trackers
from harness.trackers.stitching import IdentityStitcher, Sightings, StitchingOptions
from harness.trackers.stonesoup_parts import (
    BeyondRangeDeleter,
    CoarselyGated,
    DetectionMaker,
    NumberedInitiator,
    OrderedMultiMeasurementInitiator,
    forget_before_last_update,
    lent_global_generator,
    to_datetime,
    to_seconds,
)
from mmpf.options import Positive, Probability, Settings
from mmpf.road import FloatArray
from mmpf.scan import Scan, check_scan
from mmpf.state import CONFIRMED, HIDDEN, Tracks

_HIGHEST_SPEED_MPS = 40.0


class StoneSoupOptions(Settings):
    """Settings that all of Stone Soup's trackers share.

    Attributes:
        motion: Nearly constant velocity or nearly constant acceleration, longitudinally.
        lon_noise: Power spectral density of the longitudinal acceleration (cv, m^2/s^3) or jerk (ca, m^2/s^5).
        lat_noise: Power spectral density of the lateral acceleration, m^2/s^3.
        gate_std: A detection counts for a track within this many standard deviations.
        confirm_detections: Detections before a track is confirmed.
        held_unseen_s: An unconfirmed track ends when unseen for longer.
        longest_unseen_s: A confirmed one.
        largest_std_lon_m: A track spread wider than this ends.
        range_margin_m: A track this far beyond the sensor's range ends.
        birth_speed_std_mps: Spread of a new track's speed around the ego's, where speed is not measured.
        birth_lat_speed_std_mps: Spread of a new track's lateral speed.
        birth_accel_std_mps2: Spread of a new track's acceleration (ca).
        hidden_after_s: Unseen for longer, a track is reported as hidden.
        coarse_gate: Whether detections far outside a track's gate are left out before Stone Soup computes distances
            to them. The Kalman trackers' tracks stay the same, in about half the time; off, they run as Stone Soup
            ships them.
    """

    motion: Literal["cv", "ca"] = "cv"
    lon_noise: Positive = 1.0
    lat_noise: Positive = 0.1
    gate_std: Positive = 3.9
    confirm_detections: Annotated[int, Field(ge=1)] = 3
    held_unseen_s: Positive = 0.35
    longest_unseen_s: Positive = 5.0
    largest_std_lon_m: Positive = 5.0
    range_margin_m: Annotated[float, Field(ge=0.0)] = 4.0
    birth_speed_std_mps: Positive = 10.0
    birth_lat_speed_std_mps: Positive = 1.0
    birth_accel_std_mps2: Positive = 1.0
    hidden_after_s: Positive = 0.5
    coarse_gate: bool = False


class JpdaOptions(StoneSoupOptions):
    """Settings of the JPDA tracker.

    Attributes:
        detection_probability: Used in association; None takes the sensor's. Vehicles that others hide are missed
            far more often than the data sheet says, and JPDA knows of no shadows.
    """

    detection_probability: Probability | None = None


class StitchedJpdaOptions(JpdaOptions):
    """Settings of the JPDA tracker with identity stitching.

    Attributes:
        stitching: When a new track takes a lost one's identity.
    """

    stitching: StitchingOptions = StitchingOptions()


class ParticleOptions(StoneSoupOptions):
    """Settings of the particle tracker.

    Attributes:
        particles: Particles per track.
    """

    particles: Annotated[int, Field(ge=10)] = 300


@dataclass(frozen=True)
class _StateLayout:
    """Rows of the state vector."""

    lon: int
    speed: int
    accel: int | None
    lat: int
    lat_speed: int
    size: int


_LAYOUTS = {"cv": _StateLayout(0, 1, None, 2, 3, 4), "ca": _StateLayout(0, 1, 2, 3, 4, 5)}


@dataclass(frozen=True)
class _Assembly:
    """A Stone Soup tracker and those of its parts that follow the ego or the scan."""

    tracker: MultiTargetTracker | MultiTargetMixtureTracker
    initiator: NumberedInitiator
    range_deleter: BeyondRangeDeleter
    hypothesisers: tuple[PDAHypothesiser, ...] = ()


class StoneSoupTracker:
    """A Stone Soup tracker, fed scan by scan."""

    def __init__(
        self,
        assembly: _Assembly,
        options: StoneSoupOptions,
        clutter_density_per_m2: float,
        rng: np.random.Generator | None = None,
        stitcher: IdentityStitcher | None = None,
    ) -> None:
        """Wrap a tracker that has been put together.

        Args:
            assembly: The tracker and its parts.
            options: Its settings.
            clutter_density_per_m2: Expected false detections per square metre.
            rng: Lent to Stone Soup as the global generator during each step; None if the tracker draws nothing.
            stitcher: Hands on identities; None leaves them as they are.
        """
        self._assembly = assembly
        self._options = options
        self._layout = _LAYOUTS[options.motion]
        self._clutter_density_per_m2 = clutter_density_per_m2
        self._rng = rng
        self._stitcher = stitcher
        self._detections = DetectionMaker(self._layout.size, (self._layout.lon, self._layout.lat, self._layout.speed))
        self._first_seen_s: dict[int, float] = {}
        self._time_s: float | None = None

    def step(self, scan: Scan) -> Tracks:
        """Take in one scan and return the confirmed tracks.

        Raises:
            InvalidScanError: See ``mmpf.scan.check_scan``.
        """
        check_scan(scan, self._time_s)
        self._time_s = scan.time_s
        self._follow_ego(scan)
        moment = to_datetime(scan.time_s)
        detections = self._detections.make(scan.detections, moment)
        with nullcontext() if self._rng is None else lent_global_generator(self._rng):
            self._assembly.tracker.update_tracker(moment, detections)
        return self._report(scan.time_s)

    def _follow_ego(self, scan: Scan) -> None:
        assembly = self._assembly
        assembly.initiator.expect_speed(self._layout.speed, scan.ego.speed_mps)
        assembly.range_deleter.ego_lon_m = scan.ego.lon_m
        assembly.range_deleter.ego_lat_m = scan.ego.lat_m
        with_speed = bool(np.isfinite(scan.detections.speed_mps).all()) and len(scan.detections) > 0
        span = _HIGHEST_SPEED_MPS if with_speed else 1.0
        for hypothesiser in assembly.hypothesisers:
            hypothesiser.clutter_spatial_density = self._clutter_density_per_m2 / span

    def _report(self, time_s: float) -> Tracks:
        living = list(self._assembly.tracker.tracks)
        # Before anything is forgotten, a new track's first state is its first detection.
        started = {track.id: to_seconds(track.states[0].timestamp) for track in living}
        self._first_seen_s = {number: self._first_seen_s.get(number, first_s) for number, first_s in started.items()}
        for track in living:
            forget_before_last_update(track)
        last_s = np.array([to_seconds(track.states[0].timestamp) for track in living])
        tracks = self._to_tracks(living, time_s - last_s)
        return tracks if self._stitcher is None else self._stitch(self._stitcher, tracks, living, last_s)

    def _stitch(self, stitcher: IdentityStitcher, tracks: Tracks, living: list[Track], last_s: FloatArray) -> Tracks:
        first_s = np.array([self._first_seen_s[track.id] for track in living])
        stitched = stitcher.stitch(tracks, Sightings(first_s, last_s), self._time_s or 0.0)
        replaced = set(stitched.replaced.tolist())
        for track in living:
            if track.id in replaced:
                self._assembly.tracker.tracks.discard(track)
        return stitched.tracks

    def _to_tracks(self, living: list[Track], unseen_s: FloatArray) -> Tracks:
        if not living:
            return Tracks.none()
        layout = self._layout
        mean = np.array([np.asarray(track.state.mean, dtype=float).ravel() for track in living])
        covariance = np.array([np.asarray(track.state.covar, dtype=float) for track in living])
        std = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2), 1e-12))
        hidden = unseen_s > self._options.hidden_after_s
        return Tracks(
            track_id=np.array([track.id for track in living], dtype=np.int64),
            lon_m=mean[:, layout.lon],
            lat_m=mean[:, layout.lat],
            speed_mps=mean[:, layout.speed],
            lat_speed_mps=mean[:, layout.lat_speed],
            accel_mps2=np.zeros(len(living)) if layout.accel is None else mean[:, layout.accel],
            std_lon_m=std[:, layout.lon],
            std_lat_m=std[:, layout.lat],
            std_speed_mps=std[:, layout.speed],
            existence=np.ones(len(living)),
            state=np.where(hidden, HIDDEN, CONFIRMED).astype(np.int8),
        )


@trackers.register("stonesoup-gnn")
def build_gnn(setting: TrackerSetting, options: Mapping[str, object]) -> StoneSoupTracker:
    """Kalman filters with global nearest neighbour association by Mahalanobis distance."""
    chosen = StoneSoupOptions.model_validate(dict(options))
    predictor, updater = _kalman(chosen)
    initiator, held = _initiators(chosen, predictor, updater)
    range_deleter = _range_deleter(chosen, setting)
    tracker = MultiTargetTracker(
        initiator=held,
        deleter=_deleter(chosen, range_deleter),
        detector=None,
        data_associator=_nearest_neighbour(chosen, predictor, updater),
        updater=updater,
    )
    return _wrap(_Assembly(tracker, initiator, range_deleter), chosen, setting)


@trackers.register("stonesoup-jpda")
def build_jpda(setting: TrackerSetting, options: Mapping[str, object]) -> StoneSoupTracker:
    """Kalman filters with joint probabilistic data association, exact by efficient hypothesis management (EHM2)."""
    chosen = JpdaOptions.model_validate(dict(options))
    return _wrap(_jpda_assembly(chosen, setting), chosen, setting)


@trackers.register("stonesoup-jpda-stitched")
def build_stitched_jpda(setting: TrackerSetting, options: Mapping[str, object]) -> StoneSoupTracker:
    """``stonesoup-jpda``, and a newly confirmed track near a lost one takes its identity."""
    chosen = StitchedJpdaOptions.model_validate(dict(options))
    stitcher = IdentityStitcher(chosen.stitching)
    return _wrap(_jpda_assembly(chosen, setting), chosen, setting, stitcher=stitcher)


@trackers.register("stonesoup-particle")
def build_particle(setting: TrackerSetting, options: Mapping[str, object]) -> StoneSoupTracker:
    """A bootstrap particle filter for each track, with global nearest neighbour association."""
    chosen = ParticleOptions.model_validate(dict(options))
    kalman_predictor, kalman_updater = _kalman(chosen)
    initiator, held = _initiators(chosen, kalman_predictor, kalman_updater)
    range_deleter = _range_deleter(chosen, setting)
    predictor = ParticlePredictor(_transition_model(chosen))
    updater = ParticleUpdater(measurement_model=None, resampler=ESSResampler())
    with lent_global_generator(setting.rng):
        particle_initiator = GaussianParticleInitiator(initiator=held, number_particles=chosen.particles)
    tracker = MultiTargetTracker(
        initiator=particle_initiator,
        deleter=_deleter(chosen, range_deleter),
        detector=None,
        data_associator=_nearest_neighbour(chosen, predictor, updater),
        updater=updater,
    )
    return _wrap(_Assembly(tracker, initiator, range_deleter), chosen, setting, rng=setting.rng)


def _wrap(
    assembly: _Assembly,
    options: StoneSoupOptions,
    setting: TrackerSetting,
    rng: np.random.Generator | None = None,
    stitcher: IdentityStitcher | None = None,
) -> StoneSoupTracker:
    # Stone Soup has no public way to be given an ordered set.
    assembly.tracker._tracks = OrderedSet()
    return StoneSoupTracker(assembly, options, setting.sensor.clutter_density_per_m2, rng, stitcher)


def _jpda_assembly(options: JpdaOptions, setting: TrackerSetting) -> _Assembly:
    predictor, updater = _kalman(options)
    initiator, held = _initiators(options, predictor, updater)
    range_deleter = _range_deleter(options, setting)
    probability = options.detection_probability
    hypothesiser = PDAHypothesiser(
        predictor=predictor,
        updater=updater,
        clutter_spatial_density=setting.sensor.clutter_density_per_m2,
        prob_detect=setting.sensor.detection_probability if probability is None else probability,
        prob_gate=float(chi2.cdf(options.gate_std**2, 2)),
    )
    tracker = MultiTargetMixtureTracker(
        initiator=held,
        deleter=_deleter(options, range_deleter),
        detector=None,
        data_associator=JPDAwithEHM2(_coarsely_gated(options, hypothesiser)),
        updater=updater,
    )
    return _Assembly(tracker, initiator, range_deleter, (hypothesiser,))


def _kalman(options: StoneSoupOptions) -> tuple[KalmanPredictor, KalmanUpdater]:
    return KalmanPredictor(_transition_model(options)), KalmanUpdater(measurement_model=None)


def _transition_model(options: StoneSoupOptions) -> CombinedLinearGaussianTransitionModel:
    longitudinal = {"cv": ConstantVelocity, "ca": ConstantAcceleration}[options.motion]
    return CombinedLinearGaussianTransitionModel([longitudinal(options.lon_noise), ConstantVelocity(options.lat_noise)])


def _nearest_neighbour(options: StoneSoupOptions, predictor: Predictor, updater: Updater) -> GNNWith2DAssignment:
    hypothesiser = DistanceHypothesiser(predictor, updater, measure=Mahalanobis(), missed_distance=options.gate_std)
    return GNNWith2DAssignment(_coarsely_gated(options, hypothesiser))


def _coarsely_gated(options: StoneSoupOptions, hypothesiser: Hypothesiser) -> Hypothesiser:
    layout = _LAYOUTS[options.motion]
    if not options.coarse_gate:
        return hypothesiser
    return CoarselyGated(hypothesiser, (layout.lon, layout.lat, layout.speed), options.gate_std)


def _initiators(
    options: StoneSoupOptions, predictor: KalmanPredictor, updater: KalmanUpdater
) -> tuple[NumberedInitiator, OrderedMultiMeasurementInitiator]:
    layout = _LAYOUTS[options.motion]
    std = np.ones(layout.size)
    std[layout.speed] = options.birth_speed_std_mps
    std[layout.lat_speed] = options.birth_lat_speed_std_mps
    if layout.accel is not None:
        std[layout.accel] = options.birth_accel_std_mps2
    prior = GaussianState(StateVector(np.zeros(layout.size)), np.diag(std**2))
    single = NumberedInitiator(prior)
    held = OrderedMultiMeasurementInitiator(
        prior_state=prior,
        deleter=UpdateTimeDeleter(timedelta(seconds=options.held_unseen_s)),
        data_associator=_nearest_neighbour(options, predictor, updater),
        updater=updater,
        min_points=options.confirm_detections,
        initiator=single,
    )
    return single, held


def _range_deleter(options: StoneSoupOptions, setting: TrackerSetting) -> BeyondRangeDeleter:
    layout = _LAYOUTS[options.motion]
    return BeyondRangeDeleter((layout.lon, layout.lat), setting.sensor.range_m + options.range_margin_m)


def _deleter(options: StoneSoupOptions, range_deleter: BeyondRangeDeleter) -> CompositeDeleter:
    layout = _LAYOUTS[options.motion]
    return CompositeDeleter(
        [
            UpdateTimeDeleter(timedelta(seconds=options.longest_unseen_s)),
            CovarianceBasedDeleter(options.largest_std_lon_m**2, mapping=[layout.lon]),
            range_deleter,
        ],
        intersect=False,
    )
