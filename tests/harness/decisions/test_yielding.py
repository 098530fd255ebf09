"""Who must yield: windows of time in closed form, where the ego holds, and what nobody has seen."""

from dataclasses import replace

import numpy as np
import pytest

from harness.decisions import yielding
from harness.decisions.belief import believe
from harness.decisions.crossings import crossings_of
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.undetected.cells import cells_of
from mmpf.undetected.intensity import Unseen
from tests.harness.decisions.scenes import LENGTH_M, bodies, egos
from tests.harness.decisions.test_crossings import GRAPH, STRAIGHT_ON, route

LIMIT_MPS = 14.0
CROSSING = crossings_of(GRAPH, STRAIGHT_ON)[0]
CELLS = cells_of(LaneGraphRoad(graph=GRAPH))[0]


def course(front_m=20.0, speed=LIMIT_MPS, on=STRAIGHT_ON):
    return yielding.EgoPath(on, front_m - 0.5 * LENGTH_M, speed, LENGTH_M)


def from_west(away_m, speed=LIMIT_MPS, **columns):
    """Return a car whose front is so far before the place of conflict, which begins at x = -2 m."""
    return bodies((0, -2.0 - away_m - 0.5 * LENGTH_M, 0.0, speed), **columns)


def holds_for(*cars, at=None):
    return [bool(yielding.who_conflicts(at or course(), CROSSING, car)[0]) for car in cars]


def test_at_the_speed_limit_the_ego_is_there_from_when_its_front_comes_until_its_rear_has_left():
    enter_s, leave_s, speed = course(front_m=20.0).window((48.0, 52.0))
    assert (enter_s, leave_s) == pytest.approx((28.0 / LIMIT_MPS, 36.0 / LIMIT_MPS))
    assert speed == pytest.approx(LIMIT_MPS)


def test_from_a_standstill_it_speeds_up_by_one_metre_per_second_squared():
    assert course(front_m=46.0, speed=0.0).window((48.0, 52.0))[0] == pytest.approx(np.sqrt(2.0 * 2.0), abs=0.1)


@pytest.mark.parametrize(
    ("speed", "limit", "away_m", "enter_s"),
    [(10.0, 10.0, 40.0, 4.0), (0.0, 14.0, 8.0, 4.0), (10.0, 12.0, 46.0, 4.0), (10.0, 12.0, 0.0, 0.0)],
)
def test_others_come_as_early_as_they_can_within_the_limit_and_leave_as_they_go_now(speed, limit, away_m, enter_s):
    of = (np.array([value]) for value in (100.0 - away_m - 2.0, speed, 4.0, limit))
    windows = yielding.windows_of((100.0, 104.0), *of)
    assert windows.enter_s[0] == pytest.approx(enter_s)
    assert windows.leave_s[0] == pytest.approx((away_m + 8.0) / speed if speed else np.inf)


def test_who_has_left_the_place_comes_there_no_more():
    windows = yielding.windows_of((100.0, 104.0), *(np.array([value]) for value in (106.5, 0.0, 4.0, 14.0)))
    assert (windows.enter_s[0], windows.leave_s[0]) == (np.inf, -np.inf)


def test_the_ego_holds_for_whoever_is_there_within_the_margin_of_its_own_window():
    """Its own is from 2 to 2.57 s; the other's takes 0.57 s too."""
    first, last = 28.0 - 8.0, 36.0
    margin_m = yielding.MARGIN_S * LIMIT_MPS
    early, late = first - margin_m, last + margin_m
    assert holds_for(from_west(early - 0.5), from_west(early + 0.5)) == [False, True]
    assert holds_for(from_west(late - 0.5), from_west(late + 0.5)) == [True, False]


def test_who_heads_elsewhere_or_is_beside_the_way_is_nobody_to_yield_to():
    assert holds_for(from_west(28.0, direction=np.pi), from_west(28.0, direction=0.5 * np.pi)) == [False, False]
    assert holds_for(from_west(28.0, direction=np.nan)) == [True]
    beside = from_west(28.0)
    assert holds_for(replace(beside, lat_m=beside.lat_m - 3.0)) == [False]


def test_where_ways_merge_who_comes_behind_must_be_able_to_slow_down_too():
    merging, at = route("south", ":turn", "east"), 38.0
    crossing, slow = crossings_of(GRAPH, merging)[0], course(at, 4.0, merging)
    _, leave_s, own_mps = slow.window(crossing.conflicts[0].own_m)
    needed_s = leave_s + yielding.MARGIN_S + (LIMIT_MPS - own_mps) ** 2 / (2.0 * 4.0 * LIMIT_MPS)
    place_m = crossing.conflicts[0].other_m[0] - 150.0
    for more_m, holds in ((-1.0, True), (1.0, False)):
        front_m = place_m - (needed_s * LIMIT_MPS + more_m)
        car = bodies((0, front_m - 0.5 * LENGTH_M, 0.0, LIMIT_MPS))
        assert yielding.who_conflicts(slow, crossing, car)[0] == holds


def test_it_holds_at_the_first_place_before_which_it_can_stop_by_four_metres_per_second_squared():
    places = (40.0, 48.0)
    assert yielding.room_before(course(20.0, 12.0), places) == pytest.approx(20.0)
    assert yielding.room_before(course(30.0, 12.0), places) == pytest.approx(18.0)
    assert yielding.room_before(course(31.0, 12.0), places) is None
    assert yielding.room_before(course(41.0, 1.0), places) == pytest.approx(7.0)


def test_it_slows_down_in_time_for_a_bend():
    narrow = replace(STRAIGHT_ON, limit_mps=np.array([14.0, 5.0, 14.0]))
    limits = course(on=narrow).speed_limits(np.array([0.0, 30.0, 45.0, 70.0]))
    assert limits == pytest.approx([np.sqrt(25.0 + 3.0 * 40.0), np.sqrt(25.0 + 3.0 * 10.0), 5.0, 14.0])


def test_a_standing_leader_takes_its_place_among_those_ahead():
    road = LaneGraphRoad(graph=GRAPH)
    ahead = bodies((0, 0.0, -20.0, 3.0), (0, 0.0, 5.0, 3.0), direction=0.5 * np.pi)
    belief = believe(ahead, egos(lon=0.0, lat=-40.0, lane=1), road)
    found = yielding.with_standing_leader(belief, 18.0).leaders
    assert found.gap_m[0] == pytest.approx([16.0, 18.0, 37.0])
    assert found.speed_mps[0] == pytest.approx([3.0, 0.0, 3.0])
    assert found.body[0].tolist() == [0, -1, 1]


def unseen(*cells):
    expected = np.zeros(len(CELLS))
    for lon_m, count in cells:
        on = np.flatnonzero(CELLS.lane == GRAPH.name.index("west") + 1)
        expected[on[np.abs(CELLS.lon_m[on] - lon_m).argmin()]] = count
    return Unseen(CELLS, expected)


def chance(field, *others, at=None):
    return yielding.unseen_in_conflict(at or course(), CROSSING, bodies(*others), field)


def test_of_unseen_vehicles_those_count_that_would_be_there_when_the_ego_is():
    assert chance(unseen()) == 0.0
    assert chance(unseen((-32.5, 0.3))) == pytest.approx(1.0 - np.exp(-0.3))
    assert chance(unseen((-32.5, 0.3), (-27.5, 0.2))) == pytest.approx(1.0 - np.exp(-0.5))
    assert chance(unseen((-12.5, 0.3), (-117.5, 0.4)), at=course(front_m=13.0)) == 0.0


def test_nobody_unseen_overtakes_a_known_vehicle_that_stands_or_is_slow():
    field = unseen((-32.5, 0.3))
    assert chance(field, (0, -20.0, 0.0, 0.0)) == 0.0
    assert chance(field, (0, -20.0, 0.0, LIMIT_MPS)) > 0.2
    assert chance(field, (0, -45.0, 0.0, 0.0)) > 0.2
