"""The stated existence against what is there, on tracks whose share of real ones is chosen."""

import numpy as np
import pytest
from scipy.stats import chi2

from tests.harness.scoring.scenes import Scene, score_run

STEPS = 250


def scene(existence, on, detected=True):
    """Return a car at 30 m and a track that is on it at some steps and 20 m away at the others, on a detection."""
    made = Scene(STEPS).vehicle("car", lon=30.0, detected=detected)
    made.clutter(np.arange(STEPS), 50.0).track(1, np.where(on, 30.0, 50.0))
    made.tracks[-1]["existence"] = existence
    return made


def calibration(made):
    return score_run(*made.tables()).metrics["existence_calibration"]


def test_each_tenth_holds_what_is_stated_against_what_is_there():
    on = np.arange(STEPS) % 5 < 3
    found = calibration(scene(0.75, on))
    (decile,) = (each for each in found["deciles"] if each["n"])
    assert decile == {
        "from": 0.7, "to": 0.8, "n": STEPS, "stated": pytest.approx(75.0), "observed": pytest.approx(60.0),
    }  # fmt: skip
    assert (found["largest_gap"], found["mean_gap"]) == (pytest.approx(15.0), pytest.approx(15.0))
    assert found["brier"] == pytest.approx(0.6 * 0.25**2 + 0.4 * 0.75**2)
    assert [(each["from"], each["to"]) for each in found["deciles"]] == [(k / 10, (k + 1) / 10) for k in range(10)]


@pytest.mark.parametrize(("existence", "place"), [(0.0, 0), (0.3, 3), (0.6, 6), (0.7, 7), (0.8999, 8), (1.0, 9)])
def test_an_edge_belongs_to_the_tenth_above_it_and_certainty_to_the_last(existence, place):
    found = calibration(scene(existence, np.ones(STEPS, dtype=bool)))
    assert [k for k, each in enumerate(found["deciles"]) if each["n"]] == [place]


def test_a_tenth_with_fewer_than_200_track_steps_is_told_and_not_judged():
    existence = np.where(np.arange(STEPS) < 199, 0.15, 0.95)
    found = calibration(scene(existence, np.ones(STEPS, dtype=bool)))
    assert (found["largest_gap"], found["mean_gap"]) == (None, pytest.approx((199 * 85.0 + 51 * 5.0) / 250))
    existence[199] = 0.15
    assert calibration(scene(existence, np.ones(STEPS, dtype=bool)))["largest_gap"] == pytest.approx(85.0)


def test_a_track_on_a_vehicle_that_nobody_sees_is_real_and_one_out_of_sight_is_not_judged():
    made = Scene(STEPS).vehicle("unseen", lon=30.0, state="hidden").clutter(np.arange(STEPS), 30.0).track(1, 30.0)
    made.tracks[-1]["existence"] = 0.85
    found = calibration(made.track(2, 90.0))
    assert (found["n"], found["deciles"][8]["observed"]) == (STEPS, 100.0)
    away = Scene(STEPS).vehicle("unseen", lon=30.0, state="hidden").track(1, 30.0)
    away.tracks[-1]["existence"] = 0.85
    # Half a second and its first step, then no detection has been near it for too long.
    assert calibration(away)["n"] == 6


def test_of_two_tracks_on_one_vehicle_the_nearer_one_is_real():
    made = scene(0.95, np.ones(STEPS, dtype=bool)).track(2, 31.0)
    made.tracks[-1]["existence"] = 0.25
    assert [calibration(made)["deciles"][k]["observed"] for k in (2, 9)] == [0.0, 100.0]


def test_tracks_that_state_no_existence_have_no_calibration():
    found = calibration(Scene(STEPS).vehicle("car", lon=30.0, detected=True).track(1, 30.0))
    assert (found["n"], found["largest_gap"], found["brier"]) == (0, None, None)


def test_the_anees_of_an_honest_tracker_is_one_in_view_and_hidden():
    rng = np.random.default_rng(0)
    steps = 4000
    half = np.arange(steps) % 40 < 20
    made = Scene(steps).vehicle("car", lon=30.0, detected=half, state=np.where(half, "visible", "hidden"))
    made.track(1, 30.0 + 0.5 * rng.standard_normal(steps), 0.5 * rng.standard_normal(steps), std=0.5,
               speed=10.0 + 0.5 * rng.standard_normal(steps))  # fmt: skip
    honest = score_run(*made.tables()).metrics["calibration"]
    assert list(honest["anees"].values()) == pytest.approx([1.0, 1.0], abs=0.06)
    assert honest["nees_median"] == pytest.approx(chi2(3).median() / 3, abs=0.04)
    assert list(honest["coverage95"].values()) == pytest.approx([95.0] * 3, abs=1.2)
    made.tracks[-1]["std_lon_m"] *= 0.5
    bolder = score_run(*made.tables()).metrics["calibration"]["anees"]
    assert bolder["visible"] == pytest.approx((4.0 + 1.0 + 1.0) / 3.0, abs=0.15)
