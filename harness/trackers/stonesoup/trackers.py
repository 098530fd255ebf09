"""Stone Soup's multi-target trackers, each put together from Stone Soup's own parts as its tutorials do.

A nearly-constant-velocity or -acceleration model in the road frame, each detection with its own noise, tracks initiated
after several detections and deleted when unseen for long or spread wide.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from datetime import timedelta

import numpy as np
from ordered_set import OrderedSet
from scipy.stats import chi2
from stonesoup.dataassociator.base import DataAssociator
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.dataassociator.probability import JPDAwithEHM2
from stonesoup.deleter.error import CovarianceBasedDeleter
from stonesoup.deleter.multi import CompositeDeleter
from stonesoup.deleter.time import UpdateTimeDeleter
from stonesoup.hypothesiser.base import Hypothesiser
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.initiator.base import Initiator
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
from stonesoup.updater import Updater
from stonesoup.updater.kalman import KalmanUpdater
from stonesoup.updater.particle import ParticleUpdater

from harness.trackers.protocol import TrackerSetting, trackers
from harness.trackers.stonesoup.adapter import Assembly, StoneSoupTracker
from harness.trackers.stonesoup.options import JpdaOptions, ParticleOptions, StitchedJpdaOptions, StoneSoupOptions
from harness.trackers.stonesoup.parts import (
    BeyondRangeDeleter,
    CoarselyGated,
    NumberedInitiator,
    OrderedMultiMeasurementInitiator,
    lent_global_generator,
)
from harness.trackers.stonesoup.stitching import IdentityStitcher


@trackers.register("stonesoup-gnn")
def build_gnn(setting: TrackerSetting, options: Mapping[str, object]) -> StoneSoupTracker:
    """Kalman filters with global nearest neighbour association by Mahalanobis distance."""
    chosen = StoneSoupOptions.model_validate(dict(options))
    predictor, updater = _kalman(chosen)
    initiators = _initiators(chosen, predictor, updater)
    associator = _nearest_neighbour(chosen, predictor, updater)
    assembly = _assembly(MultiTargetTracker, chosen, setting, initiators, associator, updater)
    return StoneSoupTracker(assembly, chosen, setting.sensor.clutter_density_per_m2)


@trackers.register("stonesoup-jpda")
def build_jpda(setting: TrackerSetting, options: Mapping[str, object]) -> StoneSoupTracker:
    """Kalman filters with joint probabilistic data association, exact by efficient hypothesis management (EHM2)."""
    return _jpda(JpdaOptions.model_validate(dict(options)), setting)


@trackers.register("stonesoup-jpda-stitched")
def build_stitched_jpda(setting: TrackerSetting, options: Mapping[str, object]) -> StoneSoupTracker:
    """``stonesoup-jpda``, and a newly confirmed track near a lost one takes its identity."""
    chosen = StitchedJpdaOptions.model_validate(dict(options))
    return _jpda(chosen, setting, IdentityStitcher(chosen.stitching))


@trackers.register("stonesoup-particle")
def build_particle(setting: TrackerSetting, options: Mapping[str, object]) -> StoneSoupTracker:
    """A bootstrap particle filter for each track, with global nearest neighbour association."""
    chosen = ParticleOptions.model_validate(dict(options))
    single, held = _initiators(chosen, *_kalman(chosen))
    predictor = ParticlePredictor(_transition_model(chosen))
    updater = ParticleUpdater(measurement_model=None, resampler=ESSResampler())
    with lent_global_generator(setting.rng):
        drawing = GaussianParticleInitiator(initiator=held, number_particles=chosen.particles)
    associator = _nearest_neighbour(chosen, predictor, updater)
    assembly = _assembly(MultiTargetTracker, chosen, setting, (single, drawing), associator, updater)
    return StoneSoupTracker(assembly, chosen, setting.sensor.clutter_density_per_m2, rng=setting.rng)


def _jpda(options: JpdaOptions, setting: TrackerSetting, stitcher: IdentityStitcher | None = None) -> StoneSoupTracker:
    predictor, updater = _kalman(options)
    probability, clutter = options.detection_probability, setting.sensor.clutter_density_per_m2
    hypothesiser = PDAHypothesiser(
        predictor=predictor,
        updater=updater,
        clutter_spatial_density=clutter,
        prob_detect=setting.sensor.detection_probability if probability is None else probability,
        prob_gate=float(chi2.cdf(options.gate_std**2, 2)),
    )
    initiators = _initiators(options, predictor, updater)
    associator = JPDAwithEHM2(_coarsely_gated(options, hypothesiser))
    assembly = _assembly(MultiTargetMixtureTracker, options, setting, initiators, associator, updater)
    return StoneSoupTracker(replace(assembly, hypothesisers=(hypothesiser,)), options, clutter, stitcher=stitcher)


def _assembly(
    kind: type[MultiTargetTracker | MultiTargetMixtureTracker],
    options: StoneSoupOptions,
    setting: TrackerSetting,
    initiators: tuple[NumberedInitiator, Initiator],
    associator: DataAssociator,
    updater: Updater,
) -> Assembly:
    """Put a tracker together; of the initiators the first begins tracks, the second holds them until confirmed."""
    layout = options.layout
    range_deleter = BeyondRangeDeleter((layout.lon, layout.lat), setting.sensor.range_m + options.range_margin_m)
    deleters = [
        UpdateTimeDeleter(timedelta(seconds=options.longest_unseen_s)),
        CovarianceBasedDeleter(options.largest_std_lon_m**2, mapping=[layout.lon]),
        range_deleter,
    ]
    tracker = kind(
        initiator=initiators[1],
        deleter=CompositeDeleter(deleters, intersect=False),
        detector=None,
        data_associator=associator,
        updater=updater,
    )
    # Stone Soup has no public way to be given an ordered set.
    tracker._tracks = OrderedSet()
    return Assembly(tracker, initiators[0], range_deleter)


def _kalman(options: StoneSoupOptions) -> tuple[KalmanPredictor, KalmanUpdater]:
    return KalmanPredictor(_transition_model(options)), KalmanUpdater(measurement_model=None)


def _transition_model(options: StoneSoupOptions) -> CombinedLinearGaussianTransitionModel:
    longitudinal = {"cv": ConstantVelocity, "ca": ConstantAcceleration}[options.motion]
    return CombinedLinearGaussianTransitionModel([longitudinal(options.lon_noise), ConstantVelocity(options.lat_noise)])


def _nearest_neighbour(options: StoneSoupOptions, predictor: Predictor, updater: Updater) -> GNNWith2DAssignment:
    hypothesiser = DistanceHypothesiser(predictor, updater, measure=Mahalanobis(), missed_distance=options.gate_std)
    return GNNWith2DAssignment(_coarsely_gated(options, hypothesiser))


def _coarsely_gated(options: StoneSoupOptions, hypothesiser: Hypothesiser) -> Hypothesiser:
    layout = options.layout
    if not options.coarse_gate:
        return hypothesiser
    return CoarselyGated(hypothesiser, (layout.lon, layout.lat, layout.speed), options.gate_std)


def _initiators(
    options: StoneSoupOptions, predictor: KalmanPredictor, updater: KalmanUpdater
) -> tuple[NumberedInitiator, OrderedMultiMeasurementInitiator]:
    layout = options.layout
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
