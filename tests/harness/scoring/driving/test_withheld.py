"""A vehicle in plain view that the tracker withholds is a missed braking, however gently the recorded ego braked."""

import numpy as np
import pandas as pd
import pytest

from harness.decisions.decide import driver_of
from harness.scoring.driving.asked import DriverSetup
from harness.scoring.driving.withheld import WithheldAhead
from harness.scoring.evidence.stretches import missed_stretches
from mmpf.map.corridor_road import highway
from tests.harness.scoring.scenes import score_run

ROAD = highway(lanes=3, lane_width_m=3.66)
ROW = {
    "lat_speed_mps": 0.0, "accel_mps2": 0.0, "heading_rad": 0.0, "length_m": 4.0, "width_m": 1.8, "lane": 2,
    "lat_m": 1.5 * 3.66, "episode": 0, "in_range": True,
}  # fmt: skip
BEFORE_S, STEP_S = 2.5, 0.1


def approach(speed, braking, reported=None, state="visible", detected=None, existence=1.0, lat=0.0):
    """Return the scores of an ego that rolls up to a car that stands in its lane and stops 3 m behind it.

    Args:
        speed: The ego's at first, m/s.
        braking: How hard it brakes, m/s².
        reported: Which steps have a track on the car; None for none.
        state: How well the car can be seen.
        detected: Which steps have a detection of it; None for all.
        existence: What the track states of itself.
        lat: How far left of the ego's middle the car stands.
    """
    steps = int((BEFORE_S + speed / braking) / STEP_S) + 15
    step = np.arange(steps)
    speeds = np.maximum(speed - braking * np.maximum(STEP_S * step - BEFORE_S, 0.0), 0.0)
    way = np.append(0.0, np.cumsum(speeds[:-1] * STEP_S))
    at = {"step": step, "time_s": STEP_S * step}
    ego = pd.DataFrame({**at, "lon_m": way, "speed_mps": speeds}).assign(
        vehicle_id="ego", is_ego=True, state="visible", **ROW
    )
    car = pd.DataFrame({**at, "lon_m": way[-1] + 7.0, "speed_mps": 0.0}).assign(
        vehicle_id="broken", is_ego=False, **ROW | {"lat_m": ROW["lat_m"] + lat}
    )
    car["state"] = state
    seen = car[np.ones(steps, dtype=bool) if detected is None else detected(step)]
    detections = seen[["step", "time_s", "lon_m", "lat_m"]].assign(truth_id="broken")
    held = car[np.zeros(steps, dtype=bool) if reported is None else reported(step)]
    tracks = held[["step", "time_s", "lon_m", "lat_m", "speed_mps", "lat_speed_mps"]].assign(
        track_id=1, existence=existence, std_lon_m=1.0, std_lat_m=0.5, std_speed_mps=1.0, state="confirmed"
    )
    return score_run(pd.concat([ego, car]), detections, tracks, driven=DriverSetup(driver_of("hdm"), ROAD))


def missed(*args, **settings):
    found = approach(*args, **settings).metrics["decisions"]
    return found["missed"], found["missed_withheld"]


@pytest.mark.parametrize("speed", [8.0, 15.0, 30.0])
@pytest.mark.parametrize("braking", [0.8, 1.5, 3.0])
def test_a_stopped_car_without_a_track_is_charged_however_gently_the_ego_came_to_a_stop(speed, braking):
    scored = approach(speed, braking)
    if braking < 2.0:
        assert scored.commands["truth_mps2"][20:].min() > -2.0
    found = scored.metrics["decisions"]
    assert (found["missed"], found["missed_withheld"], found["missed_by"]["none"]) == (1, 1, 1)
    assert scored.brakings["vehicle_id"].tolist() == ["broken"]
    assert scored.brakings["visibility"].tolist() == ["visible"]


def test_the_rule_asks_for_no_detection():
    for detected in (lambda step: step < 0, lambda step: step % 50 == 0):
        assert missed(20.0, 1.2, detected=detected) == (1, 1)


def test_a_track_that_no_driver_believes_is_none():
    assert missed(20.0, 1.2, reported=lambda step: step >= 0, existence=0.49) == (1, 1)


def test_a_stopped_car_with_a_track_is_not_charged_unless_that_flickers_and_is_mostly_not_there():
    for braking in (1.2, 3.0):
        assert missed(20.0, braking, reported=lambda step: step >= 0) == (0, 0)
        assert missed(20.0, braking, reported=lambda step: step % 3 == 0) == (1, 1)
        assert missed(20.0, braking, reported=lambda step: step % 3 != 0) == (0, 0)


def test_a_car_that_is_not_in_plain_view_or_not_in_the_way_is_charged_as_ever():
    for state in ("partial", "hidden"):
        assert missed(20.0, 1.2, state=state) == (0, 0)
        assert missed(20.0, 3.0, state=state) == (1, 0)
    assert missed(20.0, 3.0, lat=3.66) == (0, 0)


def test_a_braking_that_is_too_weak_for_a_withheld_car_is_missed():
    ahead = WithheldAhead(np.array([True, True, True, False]), np.zeros(4, dtype=bool), np.full(4, np.inf))
    needed, done = np.array([-6.0, -6.0, -1.9, -6.0]), np.array([-1.5, -5.5, 1.0, -1.5])
    assert ahead.misses(needed, done).tolist() == [True, False, False, False]


def test_who_nears_a_withheld_leader_in_less_than_four_seconds_must_brake():
    right_ahead = WithheldAhead(
        np.zeros(4, dtype=bool), np.array([True, True, True, False]), np.array([3.9, 4.0, 3.9, 1.0])
    )
    done = np.array([0.5, 0.5, -1.0, 0.5])
    assert right_ahead.misses(np.full(4, -0.5), done).tolist() == [True, False, False, False]


def test_half_a_second_out_of_one_is_one_braking_and_episodes_are_apart():
    nothing, step_s = np.zeros(40, dtype=bool), np.full(40, STEP_S)
    patchy = nothing.copy()
    patchy[[3, 5, 7, 9, 11]] = True
    one = np.zeros(40, dtype=np.int64)

    def found(differ, withheld, episode=one):
        return [each.tolist() for each in missed_stretches(differ, withheld, episode, step_s)]

    assert found(nothing, patchy) == [[3], [11]]
    assert found(patchy, nothing) == [[], []]
    assert found(nothing, patchy, (np.arange(40) >= 8).astype(np.int64)) == [[], []]
    rarer = nothing.copy()
    rarer[::3] = True
    assert found(nothing, rarer) == [[], []]
    whole = nothing.copy()
    whole[20:25] = True
    assert found(whole, patchy) == [[3, 20], [11, 24]]
