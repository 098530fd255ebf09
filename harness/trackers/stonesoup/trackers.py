"""Stone Soup's multi-target trackers, each assembled from Stone Soup's components as in its tutorials.

A nearly-constant-velocity or -acceleration model in the road frame, each detection with its own noise, tracks initiated
after several detections and deleted when unseen for long or spread wide.
"""

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

from harness.trackers.kalman import LAT_SPEED, LON, SPEED
from harness.trackers.plane import is_in_plane
from harness.trackers.protocol import TrackerSetting
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
from harness.trackers.track_options import TrackOptions, factory
from mmpf.stages.update_rule import RANGE_MARGIN_M


def _gnn(options: StoneSoupOptions, setting: TrackerSetting) -> StoneSoupTracker:
    """Kalman filters with global nearest neighbour association by Mahalanobis distance."""
    return StoneSoupTracker(_assembly(MultiTargetTracker, options, setting, _nearest_neighbour(options)), options)


def _immortal(options: ImmortalOptions, setting: TrackerSetting) -> StoneSoupTracker:
    """Kalman filters whose confirmed tracks are predicted for as long as they are within range (arXiv 2111.13672)."""
    reach_m = options.gate_lon_m, options.gate_lon_m if is_in_plane(setting) else options.gate_lat_m
    measure, missed = (
        (_in_shares_of(reach_m), 1.0) if options.association == "distance" else (Mahalanobis(), options.gate_std)
    )
    hypothesiser = DistanceHypothesiser(*_kalman(options), measure=measure, missed_distance=missed)
    associator = GNNWith2DAssignment(WithinReach(hypothesiser, reach_m))
    return StoneSoupTracker(_assembly(MultiTargetTracker, options, setting, associator), options)


def _in_shares_of(reach_m: tuple[float, float]) -> EuclideanWeighted:
    """Return the distance between two measurements in shares of the largest ones; a measured speed does not count."""
    position = np.array([0, 1])
    return EuclideanWeighted(1.0 / np.square(reach_m), mapping=position, mapping2=position)


def _jpda(options: JpdaOptions, setting: TrackerSetting) -> StoneSoupTracker:
    """Kalman filters with joint probabilistic data association, exact by efficient hypothesis management (EHM2)."""
    probability = options.detection_probability
    hypothesiser = PDAHypothesiser(
        *_kalman(options),
        clutter_spatial_density=options.clutter_factor * setting.sensor.clutter_density_per_m2,
        prob_detect=setting.sensor.detection_probability if probability is None else probability,
        prob_gate=float(chi2.cdf(options.gate_std**2, 2)),
    )
    assembly = _assembly(MultiTargetMixtureTracker, options, setting, JPDAwithEHM2(hypothesiser))
    # A newly confirmed track near a lost one takes its identity.
    stitcher = IdentityStitcher(options.stitching) if isinstance(options, StitchedJpdaOptions) else None
    return StoneSoupTracker(replace(assembly, hypothesiser=hypothesiser), options, stitcher)


build_gnn = factory(StoneSoupOptions, _gnn)
build_jpda = factory(JpdaOptions, _jpda)
build_stitched_jpda = factory(StitchedJpdaOptions, _jpda)
build_immortal = factory(ImmortalOptions, _immortal)


def _assembly(
    kind: type[MultiTargetTracker | MultiTargetMixtureTracker],
    options: TrackOptions,
    setting: TrackerSetting,
    associator: DataAssociator,
) -> Assembly:
    begins, holds = _initiators(options)
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
        updater=_kalman(options)[1],
    )
    # Stone Soup has no public way to be given an ordered set.
    tracker._tracks = OrderedSet()
    return Assembly(tracker, begins, range_deleter)


def _kalman(options: TrackOptions) -> tuple[KalmanPredictor, KalmanUpdater]:
    axes = [ConstantVelocity(options.lon_noise), ConstantVelocity(options.lat_noise)]
    return KalmanPredictor(CombinedLinearGaussianTransitionModel(axes)), KalmanUpdater(measurement_model=None)


def _nearest_neighbour(options: TrackOptions) -> GNNWith2DAssignment:
    measure = Mahalanobis()
    return GNNWith2DAssignment(DistanceHypothesiser(*_kalman(options), measure, missed_distance=options.gate_std))


def _initiators(options: TrackOptions) -> tuple[NumberedInitiator, OrderedMultiMeasurementInitiator]:
    """Return what begins tracks, and what holds them until they are confirmed."""
    std = np.ones(STATE_SIZE)
    std[SPEED], std[LAT_SPEED] = options.birth_speed_std_mps, options.birth_lat_speed_std_mps
    prior = GaussianState(StateVector(np.zeros(STATE_SIZE)), np.diag(std**2))
    single = NumberedInitiator(prior)
    held = OrderedMultiMeasurementInitiator(
        prior_state=prior,
        deleter=UpdateTimeDeleter(timedelta(seconds=options.held_unseen_s)),
        data_associator=_nearest_neighbour(options),
        updater=_kalman(options)[1],
        min_points=options.confirm_detections,
        initiator=single,
    )
    return single, held
