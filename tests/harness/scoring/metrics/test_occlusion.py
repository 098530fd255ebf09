"""Occlusion events on scenes that a reader can check by hand: seen for 3 s, hidden, seen again."""

import numpy as np
import pytest

from tests.harness.scoring.scenes import Scene, score_run

GONE, BACK, END = 30, 50, 80
STEPS = np.arange(END)


def occluded(back=BACK, end=END, hidden_share=1.0):
    """One vehicle, last detected at step ``GONE - 1`` and again from ``back`` on."""
    steps = np.arange(end)
    dark = (steps >= GONE) & (steps < GONE + round(hidden_share * (back - GONE)))
    return Scene(end).vehicle(
        "a", lon=20.0, state=np.where(dark, "hidden", "visible"), detected=(steps < GONE) | (steps >= back)
    )


def outcome_of(scene):
    scored = score_run(*scene.tables())
    assert len(scored.events) == 1
    counts = scored.metrics["occlusion"]
    assert counts["events"] == counts["survived"] + counts["hijacked"] + counts["lost"] == 1
    return scored.events.iloc[0]


def test_a_track_that_waits_for_its_vehicle_keeps_the_same_id():
    event = outcome_of(occluded().track(7, lon=20.0))
    assert event["outcome"] == "same_id"
    assert event["track_id"] == 7
    assert event["duration_s"] == pytest.approx(2.1)
    assert event["reacquire_s"] == 0.0


@pytest.mark.parametrize(("late_s", "told_s"), [(0.4, 0.4), (5.0, 5.0), (5.1, np.nan)])
def test_a_track_that_finds_its_vehicle_late_reacquires_late_and_after_more_than_five_seconds_not(late_s, told_s):
    end = BACK + 60
    away = (np.arange(end) >= 35) & (np.arange(end) < BACK + round(10 * late_s))
    event = outcome_of(occluded(end=end).track(7, lon=np.where(away, 30.0, 20.0)))
    assert event["reacquire_s"] == pytest.approx(told_s, nan_ok=True)
    assert (event["outcome"] == "same_id") == (late_s < 0.5)


def test_a_track_that_dies_in_the_dark_is_lost_even_if_a_new_one_takes_over_at_once():
    event = outcome_of(occluded().track(7, lon=20.0, at=STEPS[:40]).track(8, lon=20.0, at=STEPS[BACK:]))
    assert event["outcome"] == "lost"
    assert np.isnan(event["reacquire_s"])


def test_a_track_that_ends_on_another_vehicle_is_hijacked_and_one_on_nothing_has_survived():
    scene = occluded().vehicle("b", lon=60.0, detected=True).track(7, lon=np.where(STEPS < 40, 20.0, 60.0))
    assert outcome_of(scene)["outcome"] == "hijacked"
    assert outcome_of(occluded().track(7, lon=np.where(STEPS < 40, 20.0, 90.0)))["outcome"] == "survived"


def test_a_vehicle_without_a_track_at_the_onset_counts_as_lost_and_untracked():
    scene = occluded()
    assert outcome_of(scene)["outcome"] == "lost"
    assert score_run(*scene.tables()).metrics["occlusion"]["untracked"] == 1


def test_a_track_that_dies_only_after_the_return_was_alive_at_the_return_and_yet_is_lost():
    for last, alive in ((BACK - 1, 0), (BACK, 1)):
        counts = score_run(*occluded().track(7, lon=20.0, at=STEPS[: last + 1]).tables()).metrics["occlusion"]
        assert (counts["alive_at_return"], counts["lost"]) == (alive, 1)


def test_three_seconds_part_short_from_long_events():
    for gap_steps, short, long in ((30, 1, 0), (31, 0, 1), (100, 0, 1)):
        scene = occluded(back=GONE - 1 + gap_steps, end=170).track(7, lon=20.0)
        counts = score_run(*scene.tables()).metrics["occlusion"]
        assert (counts["short"]["events"], counts["long"]["events"]) == (short, long)


@pytest.mark.parametrize(
    "scene",
    [occluded(back=GONE + 3), occluded(back=GONE + 100, end=170), occluded(hidden_share=0.6), occluded(end=BACK + 5)],
    ids=["shorter than 0.5 s", "longer than 10 s", "in plain view for too much of it", "over before it can be judged"],
)
def test_what_is_no_occlusion_event(scene):
    assert score_run(*scene.track(7, lon=20.0, at=np.arange(scene.steps)).tables()).metrics["occlusion"]["events"] == 0


@pytest.mark.parametrize("rate_hz", [5, 10, 25])
def test_a_vehicle_detected_for_less_than_a_second_of_the_three_before_makes_no_event(rate_hz):
    for detections, events in ((rate_hz - 1, 0), (rate_hz, 1)):
        seen = ((STEPS < GONE) & (GONE - detections <= STEPS)) | (STEPS >= BACK)
        dark = np.where((STEPS >= GONE) & (STEPS < BACK), "hidden", "visible")
        scene = Scene(END).vehicle("a", lon=20.0, state=dark, detected=seen).track(7, lon=20.0)
        tables = (table.assign(time_s=table["step"] / rate_hz) for table in scene.tables())
        assert score_run(*tables).metrics["occlusion"]["events"] == events
