"""Hidden vehicles are told apart by what hides them, a vehicle or a wall, and by whether their track took their way."""

import numpy as np
import pytest

from tests.harness.scoring.scenes import STEP_S, Scene, score_run

STEPS = 100
STEP = np.arange(STEPS)


def hidden(first: int, last: int):
    return (last > STEP) & (first <= STEP)


def seen_but(gone):
    return {"state": np.where(gone, "hidden", "visible"), "detected": ~gone}


def behind(truth, **walls):
    """Give the truth the columns of a road with walls: of each named vehicle the share that they hide."""
    truth = truth.assign(visible_fraction=np.where(truth["state"] == "hidden", 0.1, 1.0), wall_fraction=0.0)
    for name, share in walls.items():
        here = (truth["vehicle_id"] == name) & (truth["state"] == "hidden")
        truth.loc[here, "wall_fraction"] = share
    return truth


def two_hidden():
    gone = hidden(20, 60)
    return (
        Scene(STEPS)
        .vehicle("a", lon=20.0, **seen_but(gone))
        .vehicle("b", lon=60.0, **seen_but(gone))
        .track(1, lon=np.where(gone, 22.0, 20.0))
        .track(2, lon=60.0, at=STEP[:40])
        .track(3, lon=60.0, at=STEP[60:])
        .tables()
    )


def test_a_road_without_walls_has_no_such_table():
    assert "hidden_by" not in score_run(*two_hidden()).metrics


def test_costs_outcomes_and_identities_count_with_what_hides_most_of_a_vehicle():
    truth, detections, tracks = two_hidden()
    scores = score_run(behind(truth, a=0.5, b=0.4), detections, tracks).metrics
    building, vehicle = scores["hidden_by"]["building"], scores["hidden_by"]["vehicle"]
    # Of 90 % hidden, 50 % is more than half and 40 % is less.
    assert building["hidden_cost_m"] == pytest.approx(2.0)
    assert vehicle["hidden_cost_m"] == pytest.approx(10.0 * 20 / 40)
    assert (building["same_id_percent"], vehicle["same_id_percent"]) == (100.0, 0.0)
    assert (building["switches"], vehicle["switches"]) == (0, 1)
    assert building["n"] + vehicle["n"] == scores["hidden"]["n"]
    assert building["events"] + vehicle["events"] == scores["occlusion"]["events"] == 2
    assert building["hidden_n"] + vehicle["hidden_n"] == scores["hidden_outcomes"]["n"]
    assert building["hidden_tracked_percent"] == 100.0


def turning(track_turns: bool, gone=None, lost=False):
    """A car that goes 20 m along x, hidden from there turns left within 20 m, and goes on along y."""
    gone = hidden(25, 55) if gone is None else gone
    heading = np.clip((STEP - 25) / 20.0, 0.0, 1.0) * 0.5 * np.pi
    speed = 6.0
    x = np.cumsum(speed * STEP_S * np.cos(heading))
    y = np.cumsum(speed * STEP_S * np.sin(heading))
    straight_x, straight_y = speed * STEP_S * (1 + STEP), np.zeros(STEPS)
    wrong = hidden(30, 56) & (not track_turns)
    at = STEP[:40] if lost else STEP
    scene = Scene(STEPS).vehicle("a", lon=x, lat=y, **seen_but(gone))
    scene.track(1, lon=np.where(wrong, straight_x, x)[at], lat=np.where(wrong, straight_y, y)[at], at=at)
    truth, detections, tracks = scene.tables()
    truth["direction_rad"] = np.where(truth["vehicle_id"] == "a", np.tile(heading, 2), 0.0)
    return truth, detections, tracks


@pytest.mark.parametrize(
    ("tables", "right"),
    [(turning(True), 100.0), (turning(False), 0.0), (turning(True, lost=True), 0.0)],
    ids=["turns with it", "goes straight on", "let go"],
)
def test_the_route_after_an_unseen_turn_is_right_where_the_same_track_took_it(tables, right):
    scores = score_run(*tables).metrics["unseen_turns"]
    assert (scores["events"], scores["right_route_percent"], scores["foreseen_percent"]) == (1, right, right)


def test_a_turn_that_is_hidden_for_less_than_two_seconds_is_no_unseen_one():
    scores = score_run(*turning(True, gone=hidden(25, 40))).metrics
    assert scores["occlusion"]["events"] == 1
    assert scores["unseen_turns"] == {"right_route_percent": None, "foreseen_percent": None, "events": 0}


def test_a_road_with_a_frame_of_its_own_has_no_routes():
    truth, detections, tracks = turning(True)
    assert "unseen_turns" not in score_run(truth.drop(columns="direction_rad"), detections, tracks).metrics


def test_a_vehicle_on_a_roundabout_counts_there_whichever_way_it_turns():
    truth, detections, tracks = turning(True)
    ring = (truth["vehicle_id"] == "a") & (truth["step"] >= 10)
    scores = score_run(truth.assign(on_roundabout=ring), detections, tracks).metrics
    assert scores["manoeuvre"]["left"]["of_n"] == 0
    assert scores["manoeuvre"]["roundabout"]["events"] == 1
    assert scores["unseen_turns"]["events"] == 1
    assert "roundabout" not in score_run(truth, detections, tracks).metrics["manoeuvre"]
