from dataclasses import replace

import numpy as np
import pytest

from harness.trackers.catalogue import build_tracker
from harness.trackers.conformance.scripted_scenes import ROAD, SENSOR, ego_at
from harness.trackers.kalman import LAT, LAT_SPEED, LON, SPEED
from harness.trackers.protocol import TrackerSetting
from harness.trackers.rivals.oc_sort import Observations, OcSortOptions, momentum
from mmpf.options.filter import Footprint
from mmpf.scan import Scan
from mmpf.tracks import CONFIRMED
from tests.harness.trackers.rivals.test_box_kalman import detections

NOISE = {"lon_noise": 1.0, "lat_noise": 0.1}


def tracker_of(**options: object):
    # Not as tuned: the tests say what they need.
    usual = OcSortOptions()
    fixed = {
        name: getattr(usual, name) for name in ("least_overlap", "momentum_weight", "recovery_overlap", "reupdate")
    }
    options = {"longest_unseen_s": 3.0, "noise_factor": 1.0, "confirm_detections": 3, **fixed, **NOISE, **options}
    return build_tracker("oc-sort", TrackerSetting(ROAD, SENSOR, np.random.default_rng(0)), options)


def shown(tracker, times_s, places_m):
    """Show a tracker at most one detection each time, at a place in the road frame, and return its last tracks."""
    for time_s, place in zip(times_s, places_m, strict=True):
        found = detections(*([], []) if place is None else ([place[0]], [place[1]]))
        tracks = tracker.step(Scan(time_s, found, ego_at(time_s)))
    return tracks


def observed(*places: tuple[float, float], interval_s: float = 0.1) -> Observations:
    """Return the observations of one track."""
    seen = Observations.first(0.0, np.array([places[0]]))
    for k, place in enumerate(places[1:], start=1):
        seen = seen.followed(np.array([0]), interval_s * k, np.array([place]))
    return seen


def test_a_track_found_again_is_as_if_it_had_been_seen_on_a_straight_way_all_the_while():
    times = np.concatenate([0.1 * np.arange(10), [1.15, 1.2, 1.5]])  # scans need not be even
    before = [(220.0 + 12.0 * time_s + 3.0 * time_s**2, 5.0) for time_s in times[:6]]
    found = np.array([before[-1][0] + 9.0, 5.8])
    share = (times[6:-1] - times[5]) / (times[-1] - times[5])
    straight = before[-1] + share[:, None] * (found - before[-1])
    again, all_along = tracker_of(), tracker_of()
    shown(again, times, [*before, *[None] * len(share), found])
    shown(all_along, times, [*before, *straight, found])
    one, other = again._tracker._tracks.boxes, all_along._tracker._tracks.boxes
    assert one.lives.track_id.tolist() == other.lives.track_id.tolist() == [1]
    np.testing.assert_allclose(one.states.mean, other.states.mean, rtol=1e-12)
    np.testing.assert_allclose(one.states.covariance, other.states.covariance, atol=1e-12)


def test_tracks_found_again_after_gaps_of_their_own_do_not_disturb_each_other():
    times = 0.1 * np.arange(16)
    gaps = {15.0: range(6, 12), 5.0: range(9, 14), -5.0: range(0)}

    def found(time_s: float, k: int, lats: list[float]):
        seen = [lat for lat in lats if k not in gaps[lat]]
        return detections([230.0 + 14.0 * time_s + 0.1 * lat for lat in seen], seen)

    def states_of(lats: list[float]):
        tracker = tracker_of()
        for k, time_s in enumerate(times):
            tracker.step(Scan(time_s, found(time_s, k, lats), ego_at(time_s)))
        states = tracker._tracker._tracks.boxes.states.mean
        return states[np.argsort(states[:, LAT])]

    np.testing.assert_allclose(states_of(list(gaps)), np.concatenate([states_of([lat]) for lat in sorted(gaps)]))


def test_without_any_of_the_three_it_is_the_tracker_of_boxes():
    times = 0.1 * np.arange(12)
    places = [*[(220.0 + 12.0 * time_s, 5.0) for time_s in times[:6]], *[None] * 5, (234.0, 5.3)]
    bare = tracker_of(reupdate=False, momentum_weight=0.0, recovery_overlap=1.0)
    same = {"longest_unseen_s": 3.0, "confirm_detections": 3, "least_overlap": -0.4, "noise_factor": 1.0, **NOISE}
    boxes = build_tracker("box-kalman", TrackerSetting(ROAD, SENSOR, np.random.default_rng(0)), same)
    np.testing.assert_array_equal(shown(bare, times, places).lon_m, shown(boxes, times, places).lon_m)
    one, other = bare._tracker._tracks.boxes.states, boxes._tracker._tracks.states
    np.testing.assert_array_equal(one.covariance, other.covariance)


@pytest.mark.parametrize(
    ("detection", "share"),
    [((6.0, 0.0), 1.0), ((0.0, 6.0), 0.5), ((-6.0, 0.0), 0.0), ((6.0, 6.0), 0.75), ((0.2, 0.1), 0.5)],
)
def test_momentum_is_one_less_the_turn_in_half_turns(detection, share):
    seen = observed((0.0, 0.0), (1.5, 0.0), (3.0, 0.0), (4.5, 0.0))
    found = detections([detection[0]], [detection[1]])
    assert momentum(seen, found, OcSortOptions(momentum_s=0.3)) == pytest.approx(share)


def test_a_track_that_hardly_moved_has_no_momentum():
    seen = observed((0.0, 0.0), (0.2, 0.0), (0.4, 0.0), (0.6, 0.0))
    assert momentum(seen, detections([6.0, -6.0], [0.0, 0.0]), OcSortOptions()).tolist() == [[0.5, 0.5]]


def test_a_way_begins_at_the_newest_observation_that_is_old_enough_or_else_at_the_first():
    seen = observed(*[(float(k), 0.0) for k in range(30)])
    assert seen.last_m.tolist() == [[29.0, 0.0]]
    assert [seen.before_m(interval_s)[0, 0] for interval_s in (0.1, 0.3, 1.0, 9.0)] == [28.0, 26.0, 19.0, 14.0]
    assert observed((3.0, 1.0), (4.0, 1.0)).before_m(0.3).tolist() == [[3.0, 1.0]]


@pytest.mark.parametrize(("weight", "chosen"), [(0.0, "aside"), (1.0, "ahead")])
def test_momentum_decides_between_two_detections_of_like_overlap(weight, chosen):
    tracker = tracker_of(momentum_weight=weight)
    times = 0.1 * np.arange(20)
    for time_s in times:
        tracker.step(Scan(time_s, detections([200.0 + 15.0 * time_s], [5.0]), ego_at(time_s)))
    states, vehicle = tracker._tracker._tracks.boxes.states, Footprint()
    x, y = (states.mean[:, [LON, LAT]] + 0.1 * states.mean[:, [SPEED, LAT_SPEED]])[0]
    # Boxes moved by the same share of their length or width overlap alike; the one aside is a little nearer.
    places = {"ahead": (x + 0.4 * vehicle.length_m, y), "aside": (x, y + 0.39 * vehicle.width_m)}
    tracker.step(Scan(2.0, detections(*zip(*places.values(), strict=True)), ego_at(2.0)))
    tracks = tracker._tracker._tracks
    assert tracks.boxes.lives.track_id.tolist() == [1, 2]
    assert tracks.observed.last_m[0] == pytest.approx(places[chosen])


@pytest.mark.parametrize(("recovery_overlap", "identity"), [(0.3, 1), (1.0, 2)])
def test_recovery_finds_a_car_that_stopped_while_its_prediction_went_on(recovery_overlap, identity):
    tracker = tracker_of(recovery_overlap=recovery_overlap)
    times = 0.1 * np.arange(25)
    drives = [(225.0 + 15.0 * time_s, 5.0) for time_s in times[:11]]
    tracks = shown(tracker, times, [*drives, *[None] * 13, (240.5, 5.0)])
    assert tracks.track_id[np.argmin(np.abs(tracks.lon_m - 240.0))] == identity


def test_a_detection_at_the_prediction_goes_before_one_where_the_track_was_last_seen():
    tracker = tracker_of()
    times = 0.1 * np.arange(25)
    shown(tracker, times[:-1], [*[(225.0 + 15.0 * time_s, 5.0) for time_s in times[:11]], *[None] * 13])
    ahead, where_seen = 225.0 + 15.0 * times[-1], 225.0 + 15.0 * times[10]
    tracks = tracker.step(Scan(times[-1], detections([where_seen, ahead], [5.0, 5.0]), ego_at(times[-1])))
    assert tracks.lon_m[tracks.track_id == 1] == pytest.approx(ahead, abs=0.5)


def test_tracks_are_confirmed_and_end_as_their_options_say():
    tracker = tracker_of(longest_unseen_s=1.0)
    times = 0.1 * np.arange(18)
    assert shown(tracker, times[:5], [(220.0, 5.0)] * 5).state.tolist() == [CONFIRMED]
    alive = [len(shown(tracker, [time_s], [None])) for time_s in times[5:]]
    assert alive == [1] * 10 + [0] * 3


def test_a_detection_of_low_score_continues_a_track_but_starts_none():
    tracker, times = tracker_of(sure_score=0.5), 0.1 * np.arange(12)
    for time_s in times:
        both = detections([220.0 + 10.0 * time_s, 250.0], [5.0, 5.0])
        score = np.array([0.9 if time_s < 0.45 else 0.1, 0.1])
        tracks = tracker.step(Scan(time_s, replace(both, score=score), ego_at(time_s)))
    assert tracks.track_id.tolist() == [1]
    assert tracks.state.tolist() == [CONFIRMED]
