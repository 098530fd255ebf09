from __future__ import annotations

from dataclasses import replace
from datetime import timedelta

import numpy as np
import pytest

pytest.importorskip("stonesoup")

from stonesoup.models.transition.linear import CombinedLinearGaussianTransitionModel, ConstantVelocity
from stonesoup.types.detection import Detection
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.track import Track
from stonesoup.types.update import GaussianStateUpdate

from harness.trackers.catalogue import build_tracker
from harness.trackers.conformance.scripted_scenes import EGO_START_M, ROAD, SENSOR, ScriptedCar, scripted_scans
from harness.trackers.protocol import TrackerSetting
from harness.trackers.stonesoup.aware_parts import CarFollowingPredictor, MissedInViewDeleter
from harness.trackers.stonesoup.awareness import Awareness, SizeBelief
from harness.trackers.stonesoup.options import AwareJpdaOptions
from harness.trackers.stonesoup.parts import MEASURED_SIZE, to_datetime
from mmpf.options.filter import Footprint
from mmpf.scan import BodySizes, Detections, EgoPose, Scan
from mmpf.tracks import Tracks

EGO = EgoPose(0.0, 0.0, 0.0, 20.0, 4.7, 1.9)
NOTHING = Detections(*(np.zeros(0) for _ in range(6)))


def track_at(number: int, lon_m: float, lat_m: float, speed_mps: float = 20.0, std_lon_m: float = 0.1) -> Track:
    """A track that was updated at time zero by a detection of a van."""
    mean = np.array([[lon_m], [speed_mps], [lat_m], [0.0]])
    detection = Detection(mean[[0, 2]], timestamp=to_datetime(0.0), metadata={MEASURED_SIZE: ((6.0, 0.2), (2.0, 0.1))})
    covariance = np.diag([std_lon_m**2, 0.25, 0.01, 0.01])
    hypothesis = SingleHypothesis(None, detection)
    return Track([GaussianStateUpdate(mean, covariance, hypothesis, timestamp=to_datetime(0.0))], id=number)


def awareness_of(tracks: list[Track], **options: object) -> Awareness:
    awareness = Awareness(AwareJpdaOptions.model_validate(options), SENSOR, ROAD)
    awareness.learn(0.0, tracks)
    return awareness


def ego_at(lon_m: float) -> EgoPose:
    return replace(EGO, lon_m=lon_m)


def probabilities(tracks: list[Track], time_s: float = 1e-3, **options: object) -> list[float]:
    awareness = awareness_of(tracks, **options)
    awareness.look_ahead(Scan(time_s, NOTHING, EGO), tracks)
    return [awareness.of[track.id].detection_probability for track in tracks]


def test_a_size_is_the_weighted_mean_of_what_was_expected_and_measured():
    belief = SizeBelief.unmeasured(Footprint(length_m=4.0, std_length_m=2.0, width_m=2.0, std_width_m=0.3))
    for length_m in (10.0, 12.0):
        belief = belief.measured([(length_m, 1.0), (2.0, 0.1)])
    precision = 1 / 4 + 1 + 1
    assert belief.mean_m[0] == pytest.approx((4.0 / 4 + 10.0 + 12.0) / precision)
    assert belief.variance_m2[0] == pytest.approx(1 / precision)


def test_a_track_learns_its_size_from_the_detection_it_was_updated_with():
    awareness = awareness_of([track_at(1, 30.0, 0.0)])
    assert awareness.of[1].size.mean_m[0] == pytest.approx(6.0, abs=0.05)


def test_a_track_behind_another_one_is_not_expected_to_be_detected():
    ahead, behind, beside = track_at(1, 20.0, 0.0), track_at(2, 40.0, 0.0), track_at(3, 40.0, 12.0)
    seen, hidden, free = probabilities([ahead, behind, beside])
    assert seen == pytest.approx(SENSOR.detection_probability)
    assert hidden == pytest.approx(AwareJpdaOptions().hidden_probability)
    assert free == pytest.approx(SENSOR.detection_probability)


def test_a_track_that_may_be_beside_the_shadow_is_expected_by_its_share():
    ahead = track_at(1, 10.0, -3.6)
    certain, spread = track_at(2, 25.0, -9.0), track_at(2, 25.0, -9.0, std_lon_m=15.0)
    hidden = probabilities([ahead, certain])[1]
    assert hidden < probabilities([ahead, spread])[1] < SENSOR.detection_probability


def test_a_track_unseen_for_long_casts_no_shadow():
    tracks = [track_at(1, 20.0, 0.0, 0.0), track_at(2, 40.0, 0.0, 0.0)]
    assert probabilities(tracks, 0.9)[1] < 0.1
    assert probabilities(tracks, 1.1)[1] == pytest.approx(SENSOR.detection_probability)


def test_a_track_beyond_range_is_not_expected():
    assert probabilities([track_at(1, SENSOR.range_m + 20.0, 0.0)])[0] < 0.1


def test_misses_count_where_the_vehicle_should_have_been_seen_and_end_its_track():
    tracks = [track_at(1, 20.0, 0.0), track_at(2, 40.0, 0.0)]
    awareness = awareness_of(tracks)
    deleter = MissedInViewDeleter(awareness, 2.0)
    for step in range(1, 5):
        awareness.look_ahead(Scan(0.1 * step, NOTHING, ego_at(2.0 * step)), tracks)
        awareness.learn(0.1 * step, tracks)
    assert awareness.of[1].missed == pytest.approx(4 * SENSOR.detection_probability)
    assert [deleter.check_for_deletion(track) for track in tracks] == [True, False]


def predicted_speed(tracks: list[Track], number: int, time_s: float, **options: object) -> float:
    awareness = awareness_of(tracks, **options)
    awareness.look_ahead(Scan(1e-3, NOTHING, ego_at(-100.0)), tracks)
    awareness.look_ahead(Scan(time_s, NOTHING, ego_at(-100.0)), tracks)
    model = CombinedLinearGaussianTransitionModel([ConstantVelocity(1.0), ConstantVelocity(0.1)])
    predictor = CarFollowingPredictor(model, awareness=awareness, speed_row=1, lon_row=0)
    track = next(track for track in tracks if track.id == number)
    return float(predictor.predict(track, timestamp=to_datetime(time_s)).mean[1, 0])


def test_an_unseen_track_brakes_behind_a_slower_one_and_keeps_its_speed_without_a_leader():
    tracks = [track_at(1, 0.0, 0.0, 20.0), track_at(2, 20.0, 0.0, 12.0)]
    assert predicted_speed(tracks, 1, 0.6) < 19.5
    assert predicted_speed(tracks, 2, 0.6) == 12.0
    assert predicted_speed([tracks[0], track_at(2, 20.0, 3.6, 12.0)], 1, 0.6) == 20.0


def test_a_track_that_was_just_seen_is_predicted_by_its_filter_alone():
    tracks = [track_at(1, 0.0, 0.0, 20.0), track_at(2, 20.0, 0.0, 12.0)]
    assert predicted_speed(tracks, 1, 0.2) == 20.0


def test_a_driver_keeps_the_gap_that_it_was_seen_to_keep():
    for gap_m in (12.0, 30.0):
        tracks = [track_at(1, 0.0, 0.0, 15.0), track_at(2, gap_m + 6.0, 0.0, 15.0)]
        assert predicted_speed(tracks, 1, 0.6) == pytest.approx(15.0, abs=0.25)


def test_predictions_of_one_question_are_one_object():
    tracks = [track_at(1, 0.0, 0.0, 20.0), track_at(2, 20.0, 0.0, 12.0)]
    awareness = awareness_of(tracks)
    awareness.look_ahead(Scan(0.6, NOTHING, ego_at(-100.0)), tracks)
    model = CombinedLinearGaussianTransitionModel([ConstantVelocity(1.0), ConstantVelocity(0.1)])
    predictor = CarFollowingPredictor(model, awareness=awareness, speed_row=1, lon_row=0)
    moment = to_datetime(0.0) + timedelta(seconds=0.6)
    assert predictor.predict(tracks[0], timestamp=moment) is predictor.predict(tracks[0], timestamp=moment)


def follow(name: str, scans: list, **options: object) -> list[Tracks]:
    tracker = build_tracker(name, TrackerSetting(ROAD, SENSOR, np.random.default_rng(0)), options)
    return [tracker.step(labelled.scan) for labelled in scans]


def test_the_immortal_keeps_a_vehicle_that_is_never_seen_again_until_it_leaves_the_range():
    car = ScriptedCar("car", EGO_START_M + 20.0, until_s=1.0)
    times = [0.1 * step for step in range(251)]
    tracks = follow("immortal-kalman", scripted_scans([car], times, np.random.default_rng(1)))
    assert [len(each) for each in tracks[10:]] == [1] * (len(tracks) - 10)
    faster = replace(car, speed_mps=32.0)
    tracks = follow("immortal-kalman", scripted_scans([faster], times, np.random.default_rng(1)))
    assert len(tracks[20]) == 1
    assert len(tracks[-1]) == 0


def test_sizes_are_used_by_the_aware_tracker_and_left_alone_by_the_others():
    car = ScriptedCar("car", EGO_START_M + 20.0)
    plain = scripted_scans([car], [0.1 * step for step in range(10)], np.random.default_rng(2))

    def with_length(length_m: float) -> list:
        sized = []
        for labelled in plain:
            detections, count = labelled.scan.detections, len(labelled.scan.detections)
            sizes = BodySizes(*(np.full(count, value) for value in (length_m, 2.5, 0.2, 0.1)))
            sized.append(replace(labelled, scan=replace(labelled.scan, detections=replace(detections, sizes=sizes))))
        return sized

    tracker = build_tracker("stonesoup-jpda-aware", TrackerSetting(ROAD, SENSOR, np.random.default_rng(0)), {})
    for labelled in with_length(16.0):
        tracker.step(labelled.scan)
    (known,) = tracker._assembly.awareness.of.values()
    assert known.size.mean_m[0] == pytest.approx(16.0, abs=0.2)
    long, short = (follow("stonesoup-jpda", with_length(length_m))[-1] for length_m in (16.0, 4.0))
    assert long.lon_m.tolist() == short.lon_m.tolist()
