"""Stone Soup's multi-target trackers, each assembled from Stone Soup's components as in its tutorials.

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
from stonesoup.deleter.base import Deleter
from stonesoup.deleter.error import CovarianceBasedDeleter
from stonesoup.deleter.multi import CompositeDeleter
from stonesoup.deleter.time import UpdateTimeDeleter
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.measures import EuclideanWeighted, Mahalanobis
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.tracker.simple import MultiTargetMixtureTracker, MultiTargetTracker
from stonesoup.types.array import StateVector
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import KalmanUpdater

from harness.trackers.doubtful import as_reported
from harness.trackers.kalman import LAT_SPEED, LON, SPEED
from harness.trackers.plane import is_in_plane
from harness.trackers.protocol import Tracker, TrackerSetting
from harness.trackers.stonesoup.adapter import Assembly, StoneSoupTracker
from harness.trackers.stonesoup.options import ImmortalOptions, JpdaOptions, StitchedJpdaOptions, StoneSoupOptions
from harness.trackers.stonesoup.parts import (
    STATE_SIZE,
    BeyondRangeDeleter,
    NumberedInitiator,
    OrderedMultiMeasurementInitiator,
    WithinReach,
)
from harness.trackers.stonesoup.stitching import IdentityStitcher
from harness.trackers.track_options import TrackOptions, in_frame
from mmpf.stages.update_rule import RANGE_MARGIN_M


def build_gnn(setting: TrackerSetting, options: Mapping[str, object]) -> Tracker:
    """Kalman filters with global nearest neighbour association by Mahalanobis distance."""
    chosen = in_frame(StoneSoupOptions, setting, options)
    predictor, updater = _kalman(chosen)
    return _one_to_one(chosen, setting, predictor, updater, _nearest_neighbour(chosen, predictor, updater))


def build_jpda(setting: TrackerSetting, options: Mapping[str, object]) -> Tracker:
    """Kalman filters with joint probabilistic data association, exact by efficient hypothesis management (EHM2)."""
    return _jpda(in_frame(JpdaOptions, setting, options), setting)


def build_stitched_jpda(setting: TrackerSetting, options: Mapping[str, object]) -> Tracker:
    """``stonesoup-jpda``, and a newly confirmed track near a lost one takes its identity."""
    chosen = in_frame(StitchedJpdaOptions, setting, options)
    return _jpda(chosen, setting, IdentityStitcher(chosen.stitching))


def build_immortal(setting: TrackerSetting, options: Mapping[str, object]) -> Tracker:
    """Kalman filters whose confirmed tracks are predicted for as long as they are within range (arXiv 2111.13672)."""
    chosen = in_frame(ImmortalOptions, setting, options)
    predictor, updater = _kalman(chosen)
    reach_m = chosen.gate_lon_m, chosen.gate_lon_m if is_in_plane(setting) else chosen.gate_lat_m
    hypothesiser = (
        DistanceHypothesiser(predictor, updater, measure=_in_shares_of(reach_m), missed_distance=1.0)
        if chosen.association == "distance"
        else DistanceHypothesiser(predictor, updater, measure=Mahalanobis(), missed_distance=chosen.gate_std)
    )
    associator = GNNWith2DAssignment(WithinReach(hypothesiser, reach_m))
    return _one_to_one(chosen, setting, predictor, updater, associator)


def _one_to_one(
    options: TrackOptions,
    setting: TrackerSetting,
    predictor: KalmanPredictor,
    updater: KalmanUpdater,
    associator: DataAssociator,
) -> Tracker:
    """Return a tracker that gives a detection to one track at most."""
    assembly = _assembly(MultiTargetTracker, options, setting, predictor, updater, associator)
    tracker = StoneSoupTracker(assembly, options, setting.sensor.clutter_density_per_m2)
    return as_reported(tracker, setting, options.doubtful)


def _in_shares_of(reach_m: tuple[float, float]) -> EuclideanWeighted:
    """Return the distance between two measurements in shares of the largest ones; a measured speed does not count."""
    position = np.array([0, 1])
    return EuclideanWeighted(1.0 / np.square(reach_m), mapping=position, mapping2=position)


def _jpda(options: JpdaOptions, setting: TrackerSetting, stitcher: IdentityStitcher | None = None) -> Tracker:
    predictor, updater = _kalman(options)
    clutter = options.clutter_factor * setting.sensor.clutter_density_per_m2
    probability = options.detection_probability
    hypothesiser = PDAHypothesiser(
        predictor=predictor,
        updater=updater,
        clutter_spatial_density=clutter,
        prob_detect=setting.sensor.detection_probability if probability is None else probability,
        prob_gate=float(chi2.cdf(options.gate_std**2, 2)),
    )
    associator = JPDAwithEHM2(hypothesiser)
    assembly = _assembly(MultiTargetMixtureTracker, options, setting, predictor, updater, associator)
    assembly = replace(assembly, hypothesisers=(hypothesiser,))
    tracker = StoneSoupTracker(assembly, options, clutter, stitcher=stitcher)
    return as_reported(tracker, setting, options.doubtful)


def _assembly(
    kind: type[MultiTargetTracker | MultiTargetMixtureTracker],
    options: TrackOptions,
    setting: TrackerSetting,
    predictor: KalmanPredictor,
    updater: KalmanUpdater,
    associator: DataAssociator,
) -> Assembly:
    begins, holds = _initiators(options, predictor, updater)
    range_deleter = BeyondRangeDeleter(setting.sensor.range_m + RANGE_MARGIN_M)
    deleters: list[Deleter] = [range_deleter]
    if isinstance(options, StoneSoupOptions):
        unseen = UpdateTimeDeleter(timedelta(seconds=options.longest_unseen_s))
        deleters = [unseen, CovarianceBasedDeleter(options.largest_std_lon_m**2, mapping=[LON]), range_deleter]
    tracker = kind(
        initiator=holds,
        deleter=CompositeDeleter(deleters, intersect=False),
        detector=None,
        data_associator=associator,
        updater=updater,
    )
    # Stone Soup has no public way to be given an ordered set.
    tracker._tracks = OrderedSet()
    return Assembly(tracker, begins, range_deleter)


def _kalman(options: TrackOptions) -> tuple[KalmanPredictor, KalmanUpdater]:
    axes = [ConstantVelocity(options.lon_noise), ConstantVelocity(options.lat_noise)]
    return KalmanPredictor(CombinedLinearGaussianTransitionModel(axes)), KalmanUpdater(measurement_model=None)


def _nearest_neighbour(
    options: TrackOptions, predictor: KalmanPredictor, updater: KalmanUpdater
) -> GNNWith2DAssignment:
    hypothesiser = DistanceHypothesiser(predictor, updater, measure=Mahalanobis(), missed_distance=options.gate_std)
    return GNNWith2DAssignment(hypothesiser)


def _initiators(
    options: TrackOptions, predictor: KalmanPredictor, updater: KalmanUpdater
) -> tuple[NumberedInitiator, OrderedMultiMeasurementInitiator]:
    """Return what begins tracks, and what holds them until they are confirmed."""
    std = np.ones(STATE_SIZE)
    std[SPEED], std[LAT_SPEED] = options.birth_speed_std_mps, options.birth_lat_speed_std_mps
    prior = GaussianState(StateVector(np.zeros(STATE_SIZE)), np.diag(std**2))
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
