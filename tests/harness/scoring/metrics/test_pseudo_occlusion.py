"""Scores at the end of times for which vehicles were hidden on purpose, in a scene small enough to work out by hand."""

import numpy as np
import pytest

from tests.harness.scoring.scenes import STEP_S, Scene, score_run

STEPS = 60
FROM, LONG, SHORT = 20, 20, 10


def scene(replaced: bool = False):
    """Return tables of two vehicles 30 m apart sideways; one is hidden for 2 s, the other for 1 s, both from 2 s on.

    The first speeds up, and its track follows at a distance of 0.5 m. The second keeps its speed; its track is 1 m off,
    and is kept or replaced by another one when the vehicle returns.
    """
    made, step = Scene(STEPS), np.arange(STEPS)
    hidden_s = STEP_S * np.maximum(0, step - (FROM - 1))
    for name, number, count, accel, off in (("long", 1, LONG, 1.0, 0.5), ("short", 2, SHORT, 0.0, 1.0)):
        away = (step >= FROM) & (step < FROM + count)
        lon, lat = 10.0 * STEP_S * step + 0.5 * accel * hidden_s**2, 30.0 * (number - 1)
        made.vehicle(name, lon, lat, np.where(away, "hidden", "visible"), ~away, speed=10.0 + accel * hidden_s)
        made.truth[-1]["pseudo_hidden_s"] = np.where(away, count * STEP_S, 0.0)
        lost = replaced and name == "short"
        at = step[~(away & lost)]
        made.track(np.where(lost & (at >= FROM), 7, number), lon[at] + off, lat, at, std=0.4)
    truth, detections, tracks = made.tables()
    return truth.fillna({"pseudo_hidden_s": 0.0}), detections, tracks


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
    scores = score_run(*scene(replaced=True), 0).metrics["pseudo_occlusion"]
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
