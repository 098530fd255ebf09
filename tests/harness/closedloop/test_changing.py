"""When the ego may change lanes, turns back, and goes through with it."""

from dataclasses import replace

import numpy as np
import pytest

from harness.closedloop.beliefs import ego_of, true_bodies
from harness.closedloop.changing import INTO_LANE_S, LaneChange, lane_middle_m, later, may_change
from harness.decisions.belief import believe
from harness.decisions.decide import driver_of
from mmpf.map.road import highway
from tests.harness.closedloop.frames import frame_of

ROAD, DRIVER = highway(), driver_of("hdm")
OWN, LEFT = 3, 2
MIDDLE, BESIDE = lane_middle_m(ROAD, OWN, 0.0), lane_middle_m(ROAD, LEFT, 0.0)


def frame(lon=(), lat=(), speed=(), ego_lat=MIDDLE, lane=OWN, **columns):
    lanes = np.full(1 + len(lon), lane)
    return frame_of([0.0, *lon], [ego_lat, *lat], [10.0, *speed], lane=lanes, **columns)


def may(now, bias_m=0.0):
    return may_change(DRIVER, true_bodies(now), ego_of(now), ROAD, LEFT, bias_m)


def test_an_empty_lane_may_be_changed_to_and_one_that_is_not_there_never():
    assert may(frame())
    assert not may_change(DRIVER, true_bodies(frame()), ego_of(frame()), ROAD, 99)


@pytest.mark.parametrize(("speed", "allowed"), [(10.0, True), (12.0, True), (18.0, False)])
def test_a_follower_may_be_cut_in_front_of_unless_it_comes_too_fast(speed, allowed):
    assert may(frame([-30.0], [BESIDE], [speed])) == allowed


def test_a_gap_that_is_safe_now_and_not_when_the_ego_gets_there_is_refused():
    """At 8 m/s more a follower 36 m behind is 12 m behind when the body comes into its lane."""
    now = frame([-40.5], [BESIDE], [18.0])
    belief = believe(true_bodies(now), ego_of(now), ROAD)
    assert DRIVER.command(belief).accepts_left[0]
    assert not may(now)


def test_everybody_goes_on_as_fast_as_now():
    now = frame([40.0, 70.0, -30.0, -50.0], [MIDDLE, MIDDLE, BESIDE, MIDDLE], [7.0, 12.0, 14.0, 9.0])
    moved = replace(now, lon_m=now.lon_m + INTO_LANE_S * now.speed_mps)
    expected = believe(true_bodies(moved), ego_of(moved), ROAD)
    found = later(believe(true_bodies(now), ego_of(now), ROAD), INTO_LANE_S)
    assert found.leaders.gap_m == pytest.approx(expected.leaders.gap_m)
    assert found.follower.gap_m == pytest.approx(expected.follower.gap_m)
    assert found.left.follower.gap_m == pytest.approx(expected.left.follower.gap_m)


def test_who_is_squeezed_in_beside_the_ego_is_in_its_way_in_whichever_lane_it_counts():
    assert not may(frame([0.5], [MIDDLE + 2.0 * np.sign(BESIDE - MIDDLE)], [10.0]))
    assert may(frame([0.5], [MIDDLE - 2.0 * np.sign(BESIDE - MIDDLE)], [10.0]))


def test_gaps_that_seem_longer_than_they_are_are_taken():
    now = frame([9.0], [BESIDE], [10.0])
    assert not may(replace(now, speed_mps=np.array([14.0, 10.0])))
    assert may(replace(now, speed_mps=np.array([14.0, 10.0])), bias_m=40.0)


def change():
    return LaneChange(DRIVER, ROAD, LEFT, 0.1)


def decided(it, told, real=None):
    return it.decide(true_bodies(told), true_bodies(told if real is None else real), ego_of(told))


def test_the_ego_waits_begins_turns_back_begins_again_and_goes_through_with_it():
    fast = frame([-20.0], [BESIDE], [20.0])
    it = change()
    assert decided(it, fast) is None
    assert decided(it, frame()) == BESIDE
    assert it.changing
    assert decided(it, fast) == MIDDLE
    assert not it.changing
    assert decided(it, frame()) == BESIDE
    across = frame([-20.0], [BESIDE], [20.0], ego_lat=0.5 * (MIDDLE + BESIDE), lane=LEFT)
    assert decided(it, across) == BESIDE
    assert it.changed().across_s == pytest.approx(0.4)
    assert it.changed().begins == (True, True)


def test_a_change_that_the_truth_forbids_is_noted_whoever_believes_that_it_may():
    it = change()
    for _ in range(3):
        decided(it, frame(), real=frame([-20.0], [BESIDE], [20.0]))
    found = it.changed()
    assert found.begins == (False,)
    assert (found.may.tolist(), found.might.tolist()) == ([True] * 3, [False] * 3)


def test_on_its_way_the_ego_minds_both_lanes_and_before_it_its_own():
    it, ego = change(), ego_of(frame())
    assert [each.lane.tolist() for each in it.in_each_lane(ego)] == [[OWN]]
    decided(it, frame())
    assert [each.lane.tolist() for each in it.in_each_lane(ego)] == [[OWN], [LEFT]]
