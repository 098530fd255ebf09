"""Who counts in ``mot`` and in ``mot_all``."""

import numpy as np
import pytest

from tests.harness.scoring.scenes import Scene, score_run

STEPS = np.arange(200)


def test_in_sight_begins_with_the_third_detection_and_ends_half_a_second_after_the_last():
    scores = score_run(*Scene(200).vehicle("a", lon=20.0, detected=STEPS < 10).track(7, lon=20.0).tables()).metrics
    assert scores["mot"]["truth_n"] == len(range(2, 15))
    assert scores["mot_all"]["truth_n"] == len(range(0, 110))


def test_a_track_on_nothing_is_false_for_half_a_second_in_mot_and_always_in_mot_all():
    scene = Scene(10).vehicle("a", lon=20.0, detected=True).track(7, lon=20.0).track(8, lon=90.0)
    scores = score_run(*scene.tables()).metrics
    assert scores["mot"]["false_tracks"] == 6  # not track 7, on a vehicle whose first two detections do not count yet
    assert scores["mot_all"]["false_tracks"] == 10


def test_a_vehicle_unseen_for_more_than_ten_seconds_returns_as_another_identity():
    for gap_steps, switches in ((100, 1), (101, 0)):
        seen = (STEPS < 10) | (9 + gap_steps <= STEPS)
        scene = Scene(200).vehicle("a", lon=20.0, detected=seen)
        scene.track(7, lon=20.0, at=STEPS[:50]).track(8, lon=20.0, at=STEPS[9 + gap_steps :])
        assert score_run(*scene.tables()).metrics["mot_all"]["id_switches"] == switches


def test_a_vehicle_beyond_the_sensors_range_is_neither_missed_nor_is_its_track_false():
    state = np.where(STEPS < 100, "visible", "out")
    scene = Scene(200).vehicle("a", lon=20.0, state=state, detected=STEPS < 100).track(7, lon=20.0)
    scores = score_run(*scene.tables()).metrics
    assert scores["mot_all"]["truth_n"] == 100
    assert (scores["mot_all"]["missed"], scores["mot_all"]["false_tracks"]) == (0, 0)


def test_the_same_name_and_track_number_in_another_episode_are_another_vehicle_and_track():
    first, second = STEPS[:100], STEPS[100:]
    scene = Scene(0).vehicle("ego", 0.0, is_ego=True, at=first).vehicle("ego", 0.0, is_ego=True, at=second, episode=1)
    scene.vehicle("a", lon=20.0, at=first, detected=True).vehicle("a", lon=20.0, at=second, detected=True, episode=1)
    scene.vehicle("b", lon=50.0, at=first, detected=True)
    scene.track(7, lon=20.0, at=first).track(8, lon=50.0, at=first).track(8, lon=20.0, at=second)
    scores = score_run(*scene.tables()).metrics
    assert scores["mot_all"]["id_switches"] == 0
    assert scores["mot_all"]["assa"] == pytest.approx(100.0)
