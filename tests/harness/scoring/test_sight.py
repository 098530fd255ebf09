"""One rule says which tracks are in sight: it follows from the detections, whatever trackers say of their tracks."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.scoring.evidence.rows import read_run
from harness.scoring.evidence.sequence import tracks_in_sight
from tests.harness.scoring.scenes import Scene, score_run, traffic

STEPS = np.arange(100)
STATES = ("confirmed", "hidden")


@pytest.mark.parametrize("state", [*STATES, np.where(STEPS % 7 < 3, "hidden", "confirmed")], ids=[*STATES, "both"])
def test_what_a_tracker_says_of_its_own_tracks_changes_no_score(state):
    truth, detections, tracks = traffic(steps=100, vehicles=30)
    said, confirmed = (tracks.assign(state=each) for each in (np.resize(state, len(tracks)), "confirmed"))
    assert score_run(truth, detections, said).metrics == score_run(truth, detections, confirmed).metrics


def test_a_track_on_an_occluded_vehicle_is_false_to_no_tracker():
    scene = Scene(100).vehicle("a", lon=20.0, state=np.where(STEPS < 30, "visible", "hidden"), detected=STEPS < 30)
    scene.track(7, lon=20.0, at=STEPS[2:])
    scores = score_run(*scene.tables()).metrics
    # Vehicle and track go out of sight together, half a second after the last detection.
    assert scores["mot"]["truth_n"] == scores["mot"]["tracks_n"] == len(range(2, 35))
    assert (scores["mot"]["missed"], scores["mot"]["false_tracks"]) == (0, 0)


def test_a_track_on_an_occluded_vehicle_is_not_false_for_another_vehicles_detections_beside_it():
    scene = Scene(100).vehicle("a", lon=20.0, state=np.where(STEPS < 30, "visible", "hidden"), detected=STEPS < 30)
    scene.vehicle("b", lon=23.0, detected=True).track(7, lon=20.0, at=STEPS[2:]).track(8, lon=23.0, at=STEPS[2:])
    scores = score_run(*scene.tables()).metrics
    assert (scores["mot"]["missed"], scores["mot"]["false_tracks"]) == (0, 0)


def test_a_track_that_has_left_its_occluded_vehicle_is_false_until_half_a_second_after_the_last_detection():
    scene = Scene(100).vehicle("a", lon=20.0, detected=STEPS < 30)
    scene.track(7, lon=np.where(STEPS < 30, 20.0, 60.0), at=STEPS)
    scores = score_run(*scene.tables()).metrics
    assert scores["mot"]["missed"] == 5  # the vehicle stays in sight at steps 30 to 34
    assert scores["mot"]["false_tracks"] == 5  # none while the first two detections do not count yet


def test_a_ghost_is_false_until_half_a_second_without_any_detection_near():
    scene = Scene(100).track(8, lon=90.0, at=STEPS[10:])
    assert score_run(*scene.tables()).metrics["mot"]["false_tracks"] == 6
    for away, false_tracks in ((3.9, 6 + 6), (4.1, 6)):
        scene = Scene(100).clutter(at=[50], lon=90.0 + away).track(8, lon=90.0, at=STEPS[10:])
        assert score_run(*scene.tables()).metrics["mot"]["false_tracks"] == false_tracks
    for aside, false_tracks in ((1.9, 6 + 6), (2.1, 6)):
        scene = Scene(100).clutter(at=[50], lon=90.0, lat=aside).track(8, lon=90.0, at=STEPS[10:])
        assert score_run(*scene.tables()).metrics["mot"]["false_tracks"] == false_tracks


def test_a_duplicate_beside_a_seen_vehicle_is_false():
    scene = Scene(100).vehicle("a", lon=20.0, detected=True).track(7, lon=20.0, at=STEPS[2:])
    scores = score_run(*scene.track(8, lon=22.0, at=STEPS[2:]).tables()).metrics
    assert scores["mot"]["false_tracks"] == 98


@pytest.mark.parametrize("seed", [0, 1])
def test_a_busy_run_has_those_tracks_in_sight_that_plain_loops_find(seed):
    assert_equal_to_plain_loops(*traffic(steps=80, vehicles=30, seed=seed), both=True)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_random_tracks_and_detections_give_what_plain_loops_find(seed):
    rng = np.random.default_rng(seed)
    steps, tracks = int(rng.integers(1, 40)), int(rng.integers(0, 5))
    half = rng.integers(0, steps + 1)
    scene = Scene(0)
    for episode, at in enumerate((np.arange(half), np.arange(half, steps))):
        scene.vehicle("ego", 0.0, is_ego=True, at=at, episode=episode)
    for number in range(tracks):
        at = np.flatnonzero(rng.random(steps) < 0.8)
        scene.track(number, lon=rng.uniform(0, 20, len(at)), lat=rng.uniform(0, 4, len(at)), at=at)
    at = rng.integers(0, steps, rng.integers(0, 2 * steps))
    scene.clutter(at, lon=rng.uniform(0, 60, len(at)), lat=rng.uniform(0, 4, len(at)))
    assert_equal_to_plain_loops(*scene.tables())


def assert_equal_to_plain_loops(truth, detections, tracks, both=False):
    rows = read_run(truth, detections, tracks)
    in_sight = tracks_in_sight(rows)
    number = rows.tracks.track_id.tolist()
    ours = dict(zip(zip(rows.tracks.step.tolist(), number, strict=True), in_sight.tolist(), strict=True))
    assert ours == plain_loops(truth, detections, tracks)
    assert not both or {True, False} == set(ours.values())


def plain_loops(truth, detections, tracks):
    """Return whether each track is in sight, by step and track number, one step after the other."""
    episode = dict(zip(truth["step"].tolist(), truth["episode"].tolist(), strict=True))
    time_s = dict(zip(truth["step"].tolist(), truth["time_s"].tolist(), strict=True))
    since_s, found = {}, {}
    for step in sorted(time_s):
        places = [(d.lon_m, d.lat_m) for d in detections[detections["step"] == step].itertuples()]
        for track in tracks[tracks["step"] == step].itertuples():
            name = (episode[step], track.track_id)
            near = any(abs(lon - track.lon_m) <= 4.0 and abs(lat - track.lat_m) <= 2.0 for lon, lat in places)
            if near or name not in since_s:
                since_s[name] = time_s[step]
            found[step, track.track_id] = time_s[step] - since_s[name] <= 0.5 + 1e-6
    return found
