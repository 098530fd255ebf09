"""Missed and phantom brakings and what else tracks do to driving, on scenes made by hand."""

import numpy as np
import pandas as pd
import pytest

from harness.decisions.decide import driver_of
from harness.scoring.driving.asked import DriverSetup
from mmpf.map.corridor_road import highway
from tests.harness.scoring.scenes import score_run

ROAD = highway(lanes=3, lane_width_m=3.66)
MIDDLE, LEFT = 1.5 * 3.66, 2.5 * 3.66
STEPS, STEP_S, SPEED = 80, 0.1, 20.0
CAR = {"lat_speed_mps": 0.0, "accel_mps2": 0.0, "heading_rad": 0.0, "length_m": 4.0, "width_m": 1.8}


class Drive:
    """The ego at 20 m/s in the middle lane; others are where they are said to be ahead of it."""

    def __init__(self):
        self.truth, self.tracks, self.detections = [], [], []
        self.car("ego", 0.0, SPEED, is_ego=True, detected=False)

    def _rows(self, ahead, speed, at):
        step = np.arange(STEPS) if at is None else np.asarray(at)
        place = SPEED * STEP_S * step + ahead
        return pd.DataFrame({"step": step, "time_s": STEP_S * step, "lon_m": place, "speed_mps": speed})

    def car(self, name, ahead, speed, lat=MIDDLE, state="visible", at=None, is_ego=False, detected=True):
        table = self._rows(ahead, speed, at).assign(
            episode=0, vehicle_id=name, lat_m=lat, lane=2, is_ego=is_ego, in_range=state != "out", state=state, **CAR
        )
        self.truth.append(table)
        seen = table[np.broadcast_to(detected, len(table))]
        self.detections.append(seen[["step", "time_s", "lon_m", "lat_m", "length_m", "width_m"]].assign(truth_id=name))
        return self

    def track(self, number, ahead, speed, lat=MIDDLE, at=None, existence=1.0, state="confirmed"):
        table = self._rows(ahead, speed, at).assign(
            track_id=number, lat_m=lat, lat_speed_mps=0.0, existence=existence, state=state,
            std_lon_m=1.0, std_lat_m=0.5, std_speed_mps=1.0,
        )  # fmt: skip
        self.tracks.append(table)
        return self

    def scored(self, driver="hdm"):
        columns = ["step", "time_s", "track_id", "lon_m", "lat_m", "speed_mps", "lat_speed_mps", "existence", "state"]
        no_tracks = pd.DataFrame(columns=[*columns, "std_lon_m", "std_lat_m", "std_speed_mps"])
        tables = [
            pd.concat(rows, ignore_index=True).sort_values("step", kind="stable", ignore_index=True)
            for rows in (self.truth, self.detections, self.tracks or [no_tracks])
        ]
        return score_run(*tables, driven=DriverSetup(driver_of(driver), ROAD))


def slow_car(**settings):
    """A car 20 m ahead that goes at 8 m/s for a second from step 50 on."""
    speed = np.where((np.arange(STEPS) >= 50) & (np.arange(STEPS) < 60), 8.0, SPEED)
    return Drive().car("slow", 24.0, speed, **settings), speed


def test_tracks_that_are_the_truth_change_no_decision():
    scene, speed = slow_car()
    found = scene.track(1, 24.0, speed).scored().metrics["decisions"]
    assert (found["missed"], found["phantom"]) == (0, 0)
    assert found["accel_difference_mps2"] == pytest.approx(0.0, abs=1e-9)
    assert found["onsets"] == 1
    assert found["lateness_s"] == 0.0
    assert found["collision_time_error_s"] == 0.0
    assert found["n"] == STEPS - 20
    assert found["km"] == pytest.approx(SPEED * STEP_S * (STEPS - 20) / 1e3)


def test_a_car_without_a_track_is_a_missed_braking_that_is_told_whole():
    scene, _ = slow_car(detected=False, state="hidden")
    scored = scene.scored()
    found = scored.metrics["decisions"]
    assert (found["missed"], found["phantom"], found["missed_hidden"]) == (1, 0, 1)
    assert found["missed_per_km"] == pytest.approx(1.0 / found["km"])
    assert found["missed_by"] == {"none": 1, "lost": 0, "displaced": 0, "hijacked": 0}
    (braking,) = scored.brakings.to_dict("records")
    assert (braking["kind"], braking["vehicle_id"], braking["visibility"]) == ("missed", "slow", "hidden")
    assert (braking["from_step"], braking["to_step"], braking["track_id"], braking["fate"]) == (50, 59, -1, "none")
    assert braking["duration_s"] == pytest.approx(1.0)
    assert np.isnan(braking["unseen_s"])
    assert found["lateness_s"] == pytest.approx(1.0)
    # 20 m at 12 m/s against no leader, which counts as ten seconds.
    assert found["collision_time_error_s"] == pytest.approx(10.0 - 20.0 / 12.0)


@pytest.mark.parametrize(("first", "last"), [(50, 53), (0, 17)])
def test_what_lasts_less_than_half_a_second_or_is_in_the_first_seconds_of_an_ego_is_no_missed_braking(first, last):
    speed = np.where((np.arange(STEPS) >= first) & (np.arange(STEPS) <= last), 8.0, SPEED)
    assert Drive().car("slow", 24.0, speed).scored().metrics["decisions"]["missed"] == 0


def test_a_lost_track_is_told_from_one_that_is_off():
    seen = np.arange(STEPS) < 45
    state = np.where(seen, "visible", "hidden")
    lost, speed = slow_car(detected=seen, state=state)
    lost.track(1, 24.0, speed[:46], at=np.arange(46))
    off, _ = slow_car(detected=seen, state=state)
    off.track(1, 24.0, SPEED)
    for scene, fate in ((lost, "lost"), (off, "displaced")):
        scored = scene.scored()
        assert scored.metrics["decisions"]["missed_by"][fate] == 1, fate
        (braking,) = scored.brakings.to_dict("records")
        assert braking["unseen_s"] == pytest.approx(0.1 * (braking["step"] - 44))


def test_a_hidden_car_before_the_leader_matters_to_who_looks_beyond_it_alone():
    def scene():
        speed = np.where((np.arange(STEPS) >= 50) & (np.arange(STEPS) < 62), 4.0, SPEED)
        drive = Drive().car("leader", 29.0, SPEED).track(1, 29.0, SPEED)
        return drive.car("beyond", 50.0, speed, state="hidden", detected=False)

    scored = scene().scored("hdm")
    assert scored.metrics["decisions"]["missed"] == 1
    assert scored.brakings["vehicle_id"].tolist() == ["beyond"]
    assert scene().scored("idm").metrics["decisions"]["missed"] == 0


def test_a_track_of_nobody_is_a_phantom_braking():
    found = Drive().track(7, 15.0, 10.0, at=np.arange(40, 50)).scored()
    assert found.metrics["decisions"]["phantom_by"] == {"displaced": 0, "hijacked": 0, "ghost": 1}
    (braking,) = found.brakings.to_dict("records")
    assert (braking["kind"], braking["track_id"], braking["vehicle_id"], braking["fate"]) == ("phantom", 7, "", "ghost")
    assert braking["truth_mps2"] > -1.0
    assert braking["tracks_mps2"] < -2.0


def test_a_track_that_strays_into_the_lane_is_a_phantom_by_displacement():
    drive = Drive().car("beside", 18.0, 15.0, lat=LEFT)
    lat = np.where((np.arange(STEPS) >= 50) & (np.arange(STEPS) < 60), MIDDLE + 1.7, LEFT)
    scored = drive.track(3, 18.0, 15.0, lat=lat).scored()
    (braking,) = scored.brakings.to_dict("records")
    assert (braking["kind"], braking["vehicle_id"], braking["fate"]) == ("phantom", "beside", "displaced")


def test_for_a_doubtful_track_the_driver_slows_down_gently_which_is_no_phantom_braking():
    scored = Drive().track(7, 15.0, 10.0, existence=0.4).scored()
    assert scored.metrics["decisions"]["phantom"] == 0
    assert scored.commands["tracks_mps2"].min() == pytest.approx(-1.5)
    assert Drive().track(7, 15.0, 10.0, existence=0.5).scored().commands["tracks_mps2"].min() < -4.0


def test_a_doubtful_track_takes_nothing_off_the_braking_for_one_that_is_sure():
    def scene(*existence):
        drive = Drive()
        for number, each in enumerate(existence):
            drive.track(number, 15.0 - 3.0 * number, 10.0, existence=each)
        return drive.scored().commands["tracks_mps2"].to_numpy()

    assert scene(1.0, 0.3) == pytest.approx(scene(1.0))


def test_a_tentative_track_moves_no_driver():
    scored = Drive().track(7, 15.0, 10.0, state="tentative").scored()
    assert scored.commands["tracks_mps2"].min() > -1.0


def test_lateness_is_the_time_until_the_tracks_demand_braking_too():
    scene, speed = slow_car()
    late = np.concatenate([speed[:3], speed[:-3]])
    assert scene.track(1, 24.0, late).scored().metrics["decisions"]["lateness_s"] == pytest.approx(0.3)


def test_a_gap_that_the_truth_forbids_and_the_tracks_offer_is_counted():
    drive = Drive().car("behind", -12.0, 28.0, lat=LEFT)
    offered = drive.scored().metrics["decisions"]
    assert (offered["forbidden_gaps"], offered["unsafe_gaps_percent"]) == (STEPS - 20, 100.0)
    known = drive.track(1, -12.0, 28.0, lat=LEFT, at=np.arange(50, STEPS)).scored().metrics["decisions"]
    assert known["unsafe_gaps_percent"] == pytest.approx(50.0)


def test_a_track_is_as_long_as_its_detections_were_measured():
    lorry = Drive().car("lorry", 30.0, SPEED)
    for table in (lorry.truth[1], lorry.detections[1]):
        table["length_m"] = 16.0
    commands = lorry.track(1, 30.0, SPEED).scored().commands
    assert commands["truth_gap_m"].to_numpy() == pytest.approx(20.0)
    assert commands["tracks_gap_m"].to_numpy() == pytest.approx(20.0)


def test_a_track_that_tells_no_speed_is_believed_to_keep_pace_with_the_ego():
    untold, told = (slow_car()[0].track(1, 24.0, speed) for speed in (np.nan, SPEED))
    assert untold.scored().metrics["decisions"] == told.scored().metrics["decisions"]


def test_without_a_road_nobody_is_asked():
    scene, _ = slow_car()
    tables = [pd.concat(rows, ignore_index=True) for rows in (scene.truth, scene.detections)]
    scored = score_run(*tables, scene.track(1, 24.0, SPEED).tracks[0])
    assert "decisions" not in scored.metrics
    assert (scored.brakings, scored.commands) == (None, None)


def test_a_run_of_no_rows_has_no_decisions_to_tell_of():
    scored = Drive().scored()
    assert len(scored.brakings) == 0
    assert scored.metrics["decisions"]["lateness_s"] is None


def test_the_egos_own_conflicts_are_told_beside_its_decisions():
    scene, speed = slow_car()
    found = scene.track(1, 24.0, speed).scored().metrics["conflicts"]
    # 20 m of room at 12 m/s for a second of eight.
    assert found["ttc_min_s"] == pytest.approx(20.0 / 12.0)
    assert found["drac_max_mps2"] == pytest.approx(0.5 * 12.0**2 / 20.0)
    assert (found["n"], found["closing_n"], found["pet_n"]) == (STEPS, 10, 0)
    assert found["ttc_below_3_percent"] == pytest.approx(12.5)
    assert found["drac_above_3_4_percent"] == pytest.approx(12.5)
    assert found["ttc_below_1_5_percent"] == 0.0
