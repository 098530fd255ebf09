"""Scores at the end of times for which vehicles were hidden on purpose, in a scene small enough to work out by hand."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from tests.harness.scoring.scenes import score_run

STEPS, STEP_S = 60, 0.1
FROM, LONG, SHORT = 20, 20, 10


def scene(short_track: str = "kept", accel_mps2: float = 1.0):
    """Return tables of two vehicles 30 m apart sideways; one is hidden for 2 s, the other for 1 s, both from 2 s on.

    The first speeds up, and its track follows at a distance of 0.5 m. The second keeps its speed; its track is kept
    1 m off, lost, or replaced by another one when the vehicle returns.
    """
    truth, detections, tracks = [], [], []
    for step in range(STEPS):
        time_s = round(step * STEP_S, 6)
        when = {"step": step, "time_s": time_s, "episode": 0}
        hidden_s = max(0.0, time_s - (FROM - 1) * STEP_S)
        ego = {
            "vehicle_id": "ego",
            "lon_m": 0.0,
            "lat_m": 0.0,
            "speed_mps": 0.0,
            "is_ego": True,
            "pseudo_hidden_s": 0.0,
        }
        truth.append({**when, **ego, "state": "visible", "in_range": True})
        for number, (name, count) in enumerate((("long", LONG), ("short", SHORT))):
            away = FROM <= step < FROM + count
            grown = 0.5 * accel_mps2 * hidden_s**2 if name == "long" else 0.0
            place = {"lon_m": 10.0 * time_s + grown, "lat_m": 30.0 * number}
            speed = 10.0 + (accel_mps2 * hidden_s if name == "long" else 0.0)
            about = {"speed_mps": speed, "is_ego": False, "state": "hidden" if away else "visible", "in_range": True}
            length = round(count * STEP_S, 6) if away else 0.0
            truth.append({**when, "vehicle_id": name, **place, **about, "pseudo_hidden_s": length})
            if not away:
                detections.append({**when, **place, "truth_id": name})
            identity, off = number + 1, 0.5 if name == "long" else 1.0
            if name == "short" and short_track == "replaced" and step >= FROM + count:
                identity = 7
            if not (name == "short" and short_track in ("lost", "replaced") and away):
                state = {"speed_mps": speed, "std_lon_m": 0.4, "std_lat_m": 0.4, "std_speed_mps": 0.5}
                shifted = {**place, "lon_m": place["lon_m"] + off}
                tracks.append({**when, "track_id": identity, **shifted, **state, "state": "confirmed"})
    made = [pd.DataFrame(rows) for rows in (truth, detections, tracks)]
    made[0]["lat_speed_mps"] = made[2]["lat_speed_mps"] = 0.0
    return made


def test_error_and_yardstick_at_the_end_of_each_window():
    scores = score_run(*scene(), 0).metrics["pseudo_occlusion"]
    assert (scores["all"]["windows"], scores["1s"]["windows"], scores["2s"]["windows"]) == (2, 1, 1)
    assert scores["2s"]["error_m"] == pytest.approx(0.5)
    # Two seconds after the last detection the vehicle has gained half the acceleration times the square of the time.
    assert scores["2s"]["constant_velocity_m"] == pytest.approx(0.5 * 2.0**2)
    assert scores["2s"]["ratio"] == pytest.approx(0.25)
    assert scores["1s"]["constant_velocity_m"] == pytest.approx(0.0, abs=1e-9)
    assert scores["all"]["cost_m"] == pytest.approx(0.75)


def test_the_ellipse_contains_what_is_within_its_quantile():
    scores = score_run(*scene(), 0).metrics["pseudo_occlusion"]
    inside = [-2.0 * np.log(0.1) >= (0.5 / 0.4) ** 2, -2.0 * np.log(0.1) >= (1.0 / 0.4) ** 2]
    assert [scores[key]["ellipse90_percent"] == 100.0 for key in ("2s", "1s")] == inside


def test_a_lost_track_costs_ten_metres_and_no_error():
    scores = score_run(*scene("replaced"), 0).metrics["pseudo_occlusion"]
    assert scores["1s"] | {"ellipse90_percent": None} == scores["1s"]
    assert scores["1s"]["error_m"] is None
    assert (scores["1s"]["followed_percent"], scores["1s"]["cost_m"]) == (0.0, 10.0)
    assert (scores["1s"]["same_id_percent"], scores["2s"]["same_id_percent"]) == (0.0, 100.0)


def test_windows_are_told_apart_by_what_the_vehicle_does():
    scores = score_run(*scene(), 0).metrics["pseudo_occlusion"]
    assert {name: scores[name]["windows"] for name in ("following", "free", "turning", "changing_lanes")} == {
        "following": 0, "free": 2, "turning": 0, "changing_lanes": 0,
    }  # fmt: skip


def test_a_window_that_the_run_cuts_off_does_not_count():
    truth, detections, tracks = scene()
    whole = [table[table["step"] < FROM + LONG - 5] for table in (truth, detections, tracks)]
    assert score_run(*whole, 0).metrics["pseudo_occlusion"]["all"]["windows"] == 1


def test_without_hidden_vehicles_there_is_no_such_score():
    truth, detections, tracks = scene()
    assert "pseudo_occlusion" not in score_run(truth.drop(columns="pseudo_hidden_s"), detections, tracks, 0).metrics
