"""The joint rule end to end: runs of misses, false objects that stay, clutter that no data sheet told of."""

from dataclasses import replace

import numpy as np
import pytest

from mmpf.belief.moments import component_moments
from mmpf.stages.update_rule import Updated
from mmpf.tracks import CONFIRMED, HIDDEN
from tests.mmpf.joint.test_rule import ALONE, IMMORTAL, PARTICLES, PLACE, cloud_at, rule_with, updated
from tests.mmpf.scenes import belief_of, lane_centre
from tests.mmpf.test_tracker import drive, tracker_with
from tests.mmpf.test_update_rules import situation_with

CARS = [(20.0, lane_centre(1)), (-15.0, lane_centre(3)), (35.0, lane_centre(4))]


def test_one_that_is_missed_for_eight_tenths_of_a_second_in_plain_view_keeps_its_name() -> None:
    tracker = tracker_with()
    before = drive(tracker, 20, CARS)
    name = before.track_id[np.argmin(np.abs(before.lon_m - 38.0 - 20.0))]
    missed = drive(tracker, 8, CARS[1:], first_step=20)
    assert missed.state[missed.track_id == name].tolist() == [HIDDEN]
    after = drive(tracker, 5, CARS, first_step=28)
    assert after.state[after.track_id == name].tolist() == [CONFIRMED]
    assert (after.state == CONFIRMED).sum() == len(CARS)


@pytest.mark.parametrize("seed", range(3))
def test_a_standing_box_that_flashes_among_traffic_is_never_probably_a_vehicle(seed: int) -> None:
    tracker, rng = tracker_with(seed=seed), np.random.default_rng(seed)
    drive(tracker, 10, CARS)
    for step in range(10, 45):
        flash = [(75.0 - 2.0 * (step - 10), lane_centre(0))] if rng.uniform() < 0.6 else []
        tracks = drive(tracker, 1, CARS + flash, first_step=step)
        assert ((tracks.state == CONFIRMED) & (tracks.existence > 0.5)).sum() == len(CARS)


@pytest.mark.parametrize("dt_s", [0.05, 0.1, 0.5])
def test_clutter_is_counted_as_it_comes_over_about_the_memory(dt_s: float) -> None:
    rule, situation, rng = rule_with(), replace(situation_with([]), dt_s=dt_s), np.random.default_rng(0)
    told = Updated(belief_of([]), np.zeros(0), 0.0, 1.0, false_detections=6.0)
    for _ in range(round(10.0 / dt_s)):
        rule.remove_add_merge(told, situation, rng)
    assert rule.known.sensor.clutter_per_scan == pytest.approx(6.0 + (1.0 - 6.0) * np.exp(-1.0), rel=1e-3)
    rule.remove_add_merge(replace(told, false_detections=None), situation, rng)
    assert rule.known.sensor.clutter_per_scan == pytest.approx(6.0 + (1.0 - 6.0) * np.exp(-1.0), rel=1e-3)


def test_a_measured_speed_that_tells_vehicles_from_clutter_no_better_than_chance_changes_nothing() -> None:
    """Its density under the vehicle is that of clutter: one over the span of speeds."""
    rule = rule_with(existence=IMMORTAL, association=ALONE | {"gate_std": 50.0})
    prior, every = belief_of([cloud_at(PLACE)], existence=[0.4]), np.full(PARTICLES, 0.5)
    place = (PLACE[0] + 1.8, PLACE[1])
    plain = updated(rule, prior, every, [place])
    situation = situation_with([place])
    std = situation.sensor.clutter_speed_span_mps / np.sqrt(2.0 * np.pi)
    detections = replace(situation.scan.detections, speed_mps=np.array([20.0]), std_speed_mps=np.array([std]))
    situation = replace(situation, scan=replace(situation.scan, detections=detections))
    occlusion = replace(rule.assert_occlusion(prior, component_moments(prior), situation), detection_probability=every)
    occlusion = replace(occlusion, run_probability=np.zeros(1), lasting_probability=np.zeros(1))
    found = rule.measurement_update(prior, component_moments(prior), occlusion, situation, np.random.default_rng(0))
    assert found.mixture.components.existence == pytest.approx(plain.mixture.components.existence)
    assert found.birth_claim == pytest.approx(plain.birth_claim)
