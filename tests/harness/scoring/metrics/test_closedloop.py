"""The scores of a drive against closed forms: a car that brakes steadily behind one that stands."""

from dataclasses import replace

import numpy as np
import pytest

from harness.scoring.metrics.closedloop import (
    IN_TIME,
    Crossed,
    DriveRecord,
    score_crossing,
    score_drive,
)

STEP_S, STEPS = 0.1, 201


def stop_behind(gap_m, speed_mps, braking_mps2):
    """Return a car that brakes steadily to a stop, first ``gap_m`` behind one that stands."""
    time_s = STEP_S * np.arange(STEPS)
    speed = np.maximum(speed_mps - braking_mps2 * time_s, 0.0)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * STEP_S)])
    demanded = np.where(speed > 0.0, -braking_mps2, 0.0)
    return DriveRecord(speed, gap_m - way, np.zeros(STEPS), demanded, demanded, STEP_S)


def test_a_steady_stop_drives_half_its_squared_speed_over_its_braking_which_is_hard_above_three():
    scored = score_drive(stop_behind(60.0, 20.0, 4.0), IN_TIME, None)
    assert 1e3 * scored["km"] == pytest.approx(20.0**2 / (2.0 * 4.0), rel=1e-6)
    assert scored["mean_speed_mps"] == pytest.approx(50.0 / 20.0, rel=1e-6)
    assert (scored["hard_brakes"], scored["hard_brakes_per_km"]) == (1, pytest.approx(1.0 / 0.05))
    assert score_drive(stop_behind(200.0, 20.0, 2.9), IN_TIME, None)["hard_brakes"] == 0


def test_the_time_with_a_short_time_to_collision_is_that_of_the_closed_form():
    """Speed v - b t over gap g - v t + b t² / 2 is 1 / 1.5 s where the two roots of a parabola lie."""
    gap, speed, braking = 41.0, 20.0, 5.0
    first, last = sorted(np.roots([0.5 * braking, -speed + 1.5 * braking, gap - 1.5 * speed]))
    scored = score_drive(stop_behind(gap, speed, braking), IN_TIME, None)
    assert scored["ttc_below_1_5_percent"] == pytest.approx(100.0 * (last - first) / (STEP_S * STEPS), abs=0.6)


def test_a_stop_that_just_avoids_the_collision_needs_its_own_braking_throughout():
    gap = 20.0**2 / (2.0 * 3.3)
    assert score_drive(stop_behind(gap, 20.0, 3.3), IN_TIME, None)["drac_above_3_4_percent"] == 0.0
    harder = score_drive(stop_behind(20.0**2 / (2.0 * 3.5), 20.0, 3.5), IN_TIME, None)
    moving_s = 20.0 / 3.5
    assert harder["drac_above_3_4_percent"] == pytest.approx(100.0 * moving_s / (STEP_S * STEPS), abs=1.5)


def test_a_braking_that_the_belief_does_not_demand_is_missed_and_one_that_the_truth_does_not_is_a_phantom():
    rolls = np.zeros(STEPS)
    needed, made_up = rolls.copy(), rolls.copy()
    needed[20:25], needed[50:54] = -2.5, -9.0  # the second lasts 0.4 s
    made_up[100:130], made_up[150:160] = -3.0, -2.0
    driven = DriveRecord(rolls + 10.0, rolls + np.inf, rolls, made_up, needed, STEP_S)
    scored = score_drive(driven, IN_TIME, None)
    assert (scored["missed"], scored["phantom"]) == (1, 2)
    assert scored["phantom_per_km"] == pytest.approx(2 / 0.2)


def test_of_the_moments_at_which_the_truth_has_it_hold_those_count_at_which_it_goes():
    holds, must = np.array([[True, True], [False, True], [False, False], [False, True]]).T
    scored = score_crossing(Crossed(3.0, 5.5, 0.4, holds, must, 1.2, yielded=False, made_brake=True))
    assert scored["unsafe_to_go_percent"] == pytest.approx(200.0 / 3.0)
    assert (scored["crossed_percent"], scored["enters_s"], scored["waited_s"]) == (100.0, 3.0, 0.4)
    assert (scored["yielded_percent"], scored["made_brake_percent"]) == (0.0, 100.0)
    assert (scored["pet_s"], scored["pet_below_1_5_percent"]) == (1.2, 100.0)


def test_who_never_crosses_or_meets_nobody_has_no_time_between():
    never = np.zeros(3, dtype=bool)
    scored = score_crossing(Crossed(None, None, 7.0, ~never, never, None, yielded=None, made_brake=False))
    assert (scored["crossed_percent"], scored["pet_s"], scored["pet_below_1_5_percent"]) == (0.0, None, 0.0)
    assert (scored["yielded_percent"], scored["unsafe_to_go_percent"]) == (None, None)


def test_a_withheld_car_that_the_ego_rolls_up_to_gently_is_a_missed_braking():
    drives_on = stop_behind(130.0, 20.0, 1.6)
    belief = replace(drives_on, demanded_mps2=np.full(STEPS, 0.5), needed_mps2=np.full(STEPS, -1.6))
    assert score_drive(belief, IN_TIME, None)["missed"] == 0
    scored = score_drive(replace(belief, withheld=np.ones(STEPS, dtype=bool)), IN_TIME, None)
    assert (scored["missed"], scored["missed_withheld"]) == (1, 1)
    seen = score_drive(replace(drives_on, withheld=np.ones(STEPS, dtype=bool)), IN_TIME, None)
    assert (seen["missed"], seen["missed_withheld"]) == (0, 0)
