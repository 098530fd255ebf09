"""Vehicles that turn, come towards the ego or go straight on are told apart by their headings."""

import numpy as np
import pytest

from harness.scoring.evidence.rows import read_run
from harness.scoring.metrics.manoeuvre import LEFT, ONCOMING, RIGHT, STRAIGHT, manoeuvres
from tests.harness.scoring.scenes import STEP_S, Scene, score_run

STEPS = 60
TIME_S = STEP_S * np.arange(STEPS)


def codes_of(direction_rad, ego_rad=0.0):
    """Return what a car with the given headings does at each step."""
    tables = Scene(STEPS).vehicle("a", lon=20.0, detected=True).tables()
    return manoeuvres(read_run(with_directions(tables[0], ego_rad, a=direction_rad), *tables[1:]))


def with_directions(truth, ego_rad=0.0, **by_vehicle):
    truth = truth.assign(direction_rad=ego_rad)
    for name, direction in by_vehicle.items():
        here = truth["vehicle_id"] == name
        truth.loc[here, "direction_rad"] = np.broadcast_to(direction, here.sum())
    return truth


@pytest.mark.parametrize("across_half_a_turn", [0.0, 3.0])
@pytest.mark.parametrize(("sign", "code"), [(1.0, LEFT), (-1.0, RIGHT)])
def test_a_quarter_turn_within_three_seconds_is_a_turn_and_the_straight_before_it_none(sign, code, across_half_a_turn):
    heading = sign * np.clip((TIME_S - 2.0) / 3.0, 0.0, 1.0) * 0.5 * np.pi + across_half_a_turn
    wrapped = np.remainder(heading + np.pi, 2 * np.pi) - np.pi
    found = codes_of(wrapped, ego_rad=across_half_a_turn)
    assert (found[20:51] == code).all()
    assert (found[:11] == STRAIGHT).all()


def test_a_bend_of_a_hundred_metres_is_no_turn():
    assert (codes_of(15.0 / 100.0 * TIME_S) == STRAIGHT).all()


def test_a_change_of_lanes_is_no_turn():
    # 3.2 m across within 3 s at 6 m/s, at a constant lateral speed, as SUMO's vehicles do it.
    heading = np.where((TIME_S > 2.0) & (TIME_S < 5.0), np.arctan2(3.2 / 3.0, 6.0), 0.0)
    assert (codes_of(heading) == STRAIGHT).all()


@pytest.mark.parametrize("ego_rad", [0.0, 1.0, -2.0])
def test_who_heads_against_the_ego_is_oncoming_and_who_crosses_its_way_is_not(ego_rad):
    assert (codes_of(ego_rad + 2.8, ego_rad) == ONCOMING).all()
    assert (codes_of(ego_rad - 3.0, ego_rad) == ONCOMING).all()
    assert (codes_of(ego_rad + 0.5 * np.pi, ego_rad) == STRAIGHT).all()


def test_errors_count_with_the_manoeuvre_of_their_step():
    heading = np.clip((TIME_S - 2.0) / 2.0, 0.0, 1.0) * 0.5 * np.pi
    tables = (
        Scene(STEPS)
        .vehicle("turning", lon=20.0, detected=True)
        .vehicle("oncoming", lon=60.0, detected=True)
        .track(1, lon=21.0, speed=12.0)
        .track(2, lon=60.5, speed=9.0)
        .tables()
    )
    truth = with_directions(tables[0], turning=heading, oncoming=np.pi)
    scores = score_run(truth, *tables[1:]).metrics["manoeuvre"]
    turning = int((manoeuvres(read_run(truth, *tables[1:])) == LEFT).sum())
    assert scores["left"]["n"] == scores["left"]["of_n"] == turning
    assert scores["straight"]["n"] == STEPS - turning
    assert (scores["left"]["speed_mps"], scores["left"]["position_m"]) == pytest.approx((2.0, 1.0))
    assert (scores["oncoming"]["speed_mps"], scores["oncoming"]["position_m"]) == pytest.approx((1.0, 0.5))
    assert scores["right"]["n"] == 0
    assert scores["right"]["speed_mps"] is None


@pytest.mark.parametrize("kept", [True, False])
def test_an_occlusion_in_which_a_vehicle_turns_is_one_of_a_turn_though_it_returns_on_a_straight(kept):
    steps = 80
    step = np.arange(steps)
    hidden = (step >= 20) & (step < 60)
    heading = np.clip((step - 25) / 15.0, 0.0, 1.0) * 0.5 * np.pi
    scene = Scene(steps).vehicle("a", lon=20.0, state=np.where(hidden, "hidden", "visible"), detected=~hidden)
    scene.track(1, lon=20.0, at=step[:60] if not kept else step)
    if not kept:
        scene.track(2, lon=20.0, at=step[60:])
    tables = scene.tables()
    scores = score_run(with_directions(tables[0], a=heading), *tables[1:]).metrics
    assert scores["occlusion"]["events"] == 1
    assert {name: scores["manoeuvre"][name]["events"] for name in scores["manoeuvre"]} == {
        "straight": 0, "left": 1, "right": 0, "oncoming": 0,
    }  # fmt: skip
    assert scores["manoeuvre"]["left"]["same_id_percent"] == (100.0 if kept else 0.0)
    hidden_rows = sum(scores["manoeuvre"][name]["hidden_n"] for name in scores["manoeuvre"])
    assert hidden_rows == scores["hidden_outcomes"]["n"] == 40


def test_a_record_of_less_than_a_second_tells_no_turn():
    tables = Scene(STEPS).vehicle("a", lon=20.0, at=np.arange(8), detected=True).tables()
    truth = with_directions(tables[0], a=np.linspace(0.0, 1.0, 8))
    assert (manoeuvres(read_run(truth, *tables[1:])) == STRAIGHT).all()
