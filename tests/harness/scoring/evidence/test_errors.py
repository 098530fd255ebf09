"""Who is scored by which track, on scenes that a reader can check by hand."""

import numpy as np
import pandas as pd
import pytest

from harness.scoring.evidence.errors import error_arrays
from tests.harness.scoring.scenes import Scene, score_run


def errors_of(scene: Scene, name="a"):
    table = score_run(*scene.tables()).errors
    return table[table["vehicle_id"] == name].set_index("step")


def hidden_after_10(steps: int) -> Scene:
    """Return a scene of a vehicle that is detected at its first ten steps, and hidden from then on."""
    seen = np.arange(steps) < 10
    return Scene(steps).vehicle("a", lon=20.0, state=np.where(seen, "visible", "hidden"), detected=seen)


def test_a_visible_vehicle_is_scored_by_the_track_within_the_gate():
    table = errors_of(Scene(5).vehicle("a", lon=20.0, lat=1.0, detected=True).track(7, lon=23.0, lat=2.5, speed=8.0))
    assert (table["outcome"] == "tracked").all()
    assert (table["matched_by"] == "gate").all()
    assert (table["track_id"] == 7).all()
    assert table["lon_error_m"].to_numpy() == pytest.approx(3.0)
    assert table["lat_error_m"].to_numpy() == pytest.approx(1.5)
    assert table["speed_error_mps"].to_numpy() == pytest.approx(-2.0)


def test_a_hidden_vehicle_is_scored_by_its_last_track_however_far_that_is():
    table = errors_of(hidden_after_10(30).track(7, lon=20.0 + np.maximum(0, np.arange(30) - 9)))
    assert (table["outcome"] == "tracked").all()
    assert table.loc[29, "lon_error_m"] == pytest.approx(20.0)
    assert table.loc[29, "matched_by"] == "identity"
    assert table.loc[29, "seconds_hidden"] == pytest.approx(2.0)
    assert table.loc[5, "seconds_hidden"] == 0.0


def test_a_track_that_jumps_from_a_hidden_vehicle_to_a_visible_one_is_hijacked():
    steps, scene = np.arange(30), hidden_after_10(30)
    scene.vehicle("b", lon=40.0, detected=steps >= 20).track(7, lon=np.where(steps < 20, 20.0, 40.5))
    table = errors_of(scene)
    assert (table.loc[:19, "outcome"] == "tracked").all()
    assert (table.loc[20:, "outcome"] == "hijacked").all()
    mae = score_run(*scene.tables()).metrics["mae"]["hidden"]
    assert (mae["n"], mae["lon_m"]) == (10, 0.0)


def test_a_track_between_its_hidden_vehicle_and_a_visible_one_but_nearer_its_own_is_not_hijacked():
    scene = hidden_after_10(30).vehicle("b", lon=25.0, detected=True).track(7, lon=22.0)
    assert (errors_of(scene)["outcome"] == "tracked").all()


def test_a_vehicle_that_was_never_detected_is_in_no_error_row():
    scene = Scene(10).vehicle("a", lon=20.0).track(7, lon=20.0)
    scored = score_run(*scene.tables())
    assert len(scored.errors) == 0
    assert scored.metrics["coverage"]["never_detected"] == 1
    assert scored.metrics["mae"]["all"]["lon_m"] is None


def test_a_vehicle_that_no_track_held_at_its_last_detection_is_untracked_while_hidden():
    table = errors_of(hidden_after_10(20).track(7, lon=20.0, at=np.arange(3)))
    assert (table.loc[3:9, "outcome"] == "missed").all()
    assert (table.loc[10:, "outcome"] == "untracked").all()


def test_a_track_that_held_a_vehicle_until_just_before_its_last_detection_still_stands_for_it():
    steps = np.arange(20)
    for missed_for, outcome in ((5, "tracked"), (6, "untracked")):
        off = (steps >= 10 - missed_for) & (steps < 10)
        assert errors_of(hidden_after_10(20).track(7, lon=np.where(off, 30.0, 20.0))).loc[15, "outcome"] == outcome


def test_a_tentative_track_is_not_scored():
    table = errors_of(Scene(5).vehicle("a", lon=20.0, detected=True).track(7, lon=20.0, state="tentative"))
    assert (table["outcome"] == "missed").all()


def test_ten_seconds_after_its_last_detection_a_hidden_vehicle_is_no_longer_scored():
    assert errors_of(hidden_after_10(150).track(7, lon=20.0)).index.max() == 109


def test_the_holder_of_a_vehicle_does_not_outlive_its_episode():
    steps = np.arange(20)
    first, second = steps[:10], steps[10:]
    scene = Scene(0)
    scene.vehicle("ego", lon=0.0, is_ego=True, at=first, episode=0)
    scene.vehicle("ego", lon=0.0, is_ego=True, at=second, episode=1)
    scene.vehicle("a", lon=20.0, at=first, detected=True, episode=0)
    scene.vehicle("a", lon=20.0, at=second, state="hidden", episode=1)
    table = errors_of(scene.track(7, lon=20.0, at=steps))
    assert table.index.max() == 9


def test_means_by_time_hidden_use_the_time_since_the_last_detection():
    scene = hidden_after_10(60).track(7, lon=20.0 + np.maximum(0, np.arange(60) - 9))
    bins = score_run(*scene.tables()).metrics["mae"]["by_seconds_hidden"]
    counts = [(row["from_s"], row["to_s"], row["n"]) for row in bins]
    assert counts == [(0, 1, 10), (1, 2, 10), (2, 3, 10), (3, 5, 20), (5, 10, 0)]
    assert [row["lon_m"] for row in bins[:4]] == pytest.approx([5.5, 15.5, 25.5, 40.5])
    assert bins[4]["lon_m"] is None


def test_a_vehicle_of_the_same_name_in_another_episode_is_another_vehicle():
    numbers = ("lon_error_m", "lat_error_m", "speed_error_mps", "lat_speed_error_mps", "seconds_hidden")
    errors = pd.DataFrame(
        {
            "episode": [0, 0, 1, 1],
            "vehicle_id": ["a", "b", "a", "b"],
            "state": "visible",
            "outcome": "tracked",
            **dict.fromkeys(numbers, 0.0),
        }
    )
    assert len(set(error_arrays(errors).vehicle)) == 4
