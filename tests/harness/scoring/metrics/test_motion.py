"""Quality of motion on tracks whose motion has a closed form."""

import math

import numpy as np
import pytest

from tests.harness.scoring.scenes import STEP_S, Scene, score_run

STEPS = 40
STEP = np.arange(STEPS)
PLACE = 30.0 + 10.0 * STEP * STEP_S


def motion(off=0.0, speed=10.0, lat_speed=0.0, accel=0.0, state="visible", number=1):
    made = Scene(STEPS).vehicle("car", lon=PLACE, detected=np.logical_or(STEP < 10, state == "visible"))
    made.truth[-1]["state"] = np.where(STEP < 10, "visible", state)
    made.track(number, PLACE + off, speed=speed)
    for table, value in ((made.truth, 0.0), (made.tracks, accel)):
        for part in table:
            part["accel_mps2"] = value
    made.tracks[-1]["lat_speed_mps"] = lat_speed
    return score_run(*made.tables()).metrics["motion"]


@pytest.mark.parametrize("off", [0.0, 1.0])
def test_a_track_that_moves_as_its_vehicle_does_has_no_errors(off):
    found = motion(off)["visible"]
    assert [found.pop(f"{name}n") for name in ("", "accel_", "heading_", "jerk_")] == [STEPS - 1] * 3 + [STEPS - 2]
    assert list(found.values()) == pytest.approx([0.0] * len(found), abs=1e-9)


def test_a_speed_that_swings_has_the_jerk_of_its_second_difference():
    found = motion(speed=10.0 + 0.1 * (-1.0) ** STEP)["visible"]
    assert found["jerk_mps3"] == pytest.approx(4.0 * 0.1 / STEP_S**2)
    assert found["true_jerk_mps3"] == 0.0


def test_a_jump_counts_once_at_the_step_that_it_happens_at():
    found = motion(off=np.where(STEP >= 20, 1.5, 0.0))["visible"]
    assert found["jump_m"] == pytest.approx(1.5 / (STEPS - 1))
    assert found["large_jumps_percent"] == pytest.approx(100.0 / (STEPS - 1))


def test_acceleration_and_heading_are_compared_with_the_truth():
    found = motion(accel=-0.7, lat_speed=1.0)["visible"]
    assert found["accel_mps2"] == pytest.approx(0.7)
    assert found["heading_deg"] == pytest.approx(math.degrees(math.atan2(1.0, 10.0)))


def test_in_the_plane_the_ways_of_track_and_vehicle_over_half_a_second_are_compared():
    def heading_error(course, turn=0.0):
        angles = course + turn * STEP * STEP_S
        ways = [np.cumsum([np.cos(each), np.sin(each)], axis=1) for each in (angles, angles + math.radians(2.0))]
        made = Scene(STEPS).vehicle("car", lon=30.0 + ways[0][0], lat=ways[0][1], detected=True)
        made.track(1, 30.0 + ways[1][0], lat=ways[1][1])
        for part in made.truth:
            part["direction_rad"] = angles
        return score_run(*made.tables()).metrics["motion"]["all"]["heading_deg"]

    assert [heading_error(np.full(STEPS, course)) for course in (0.7, np.pi, -2.0)] == pytest.approx([2.0] * 3)
    assert heading_error(np.full(STEPS, 3.0), turn=0.5) == pytest.approx(2.0)


def test_hidden_and_visible_steps_are_told_apart():
    found = motion(accel=np.where(STEP >= 10, 2.0, 0.5), state="hidden")
    assert found["visible"]["accel_mps2"] == pytest.approx(0.5)
    assert found["hidden"]["accel_mps2"] == pytest.approx(2.0)
    assert (found["visible"]["n"], found["hidden"]["n"]) == (9, 30)
    assert found["all"]["n"] == STEPS - 1


def test_a_new_identity_begins_anew():
    made = Scene(STEPS).vehicle("car", lon=PLACE, detected=True)
    made.track(1, PLACE[:20], at=STEP[:20]).track(2, PLACE[20:] + 1.5, at=STEP[20:])
    assert score_run(*made.tables()).metrics["motion"]["visible"]["n"] == STEPS - 2
    assert score_run(*made.tables()).metrics["motion"]["visible"]["accel_mps2"] is None
