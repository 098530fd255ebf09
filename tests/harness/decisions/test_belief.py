"""Who is ahead, behind and beside, on a straight road and along the ways of a graph."""

import numpy as np
import pytest

from harness.decisions.belief import NOBODY, believe
from mmpf.map.corridor_road import highway
from mmpf.map.graph_road import LaneGraphRoad
from tests.harness.decisions.scenes import LENGTH_M, bodies, egos
from tests.mmpf.map.scenes import graph_of

ROAD = highway(lanes=3, lane_width_m=3.66)
MIDDLE = 1.5 * 3.66


def ego_in_the_middle(**settings):
    return egos(lat=MIDDLE, lane=2, **settings)


def test_gaps_are_bumper_to_bumper_and_leave_out_the_bodies_between():
    belief = believe(bodies((0, 60.0, MIDDLE, 15.0), (0, 30.0, MIDDLE, 18.0)), ego_in_the_middle(), ROAD)
    assert belief.leaders.body[0].tolist() == [1, 0, NOBODY]
    assert belief.leaders.gap_m[0].tolist() == [30.0 - LENGTH_M, 60.0 - 2.0 * LENGTH_M, np.inf]
    assert belief.leaders.speed_mps[0].tolist() == [18.0, 15.0, 0.0]
    assert belief.follower.body[0] == NOBODY


def test_nearest_vehicles_are_those_of_a_plain_loop():
    rng = np.random.default_rng(3)
    steps, count = 20, 400
    ego = egos(steps, lon=rng.uniform(0, 50, steps), lat=MIDDLE, lane=2)
    places = rng.integers(0, steps, count), rng.uniform(-150, 250, count), rng.uniform(0, 11, count)
    found = bodies(*zip(*places, np.full(count, 9.0), strict=True))
    belief = believe(found, ego, ROAD)
    for step in range(steps):
        here = [body for body in range(count) if found.step[body] == step]
        along = {body: found.lon_m[body] - ego.lon_m[step] for body in here}
        in_lane = [body for body in here if abs(found.lat_m[body] - MIDDLE) <= 1.83]
        ahead = sorted((body for body in in_lane if 0.0 < along[body] <= 120.0), key=along.__getitem__)[:3]
        assert belief.leaders.body[step, : len(ahead)].tolist() == ahead
        left = [body for body in here if abs(found.lat_m[body] - MIDDLE - 3.66) <= 1.83]
        behind = sorted((body for body in left if -120.0 <= along[body] < 0.0), key=along.__getitem__)
        assert belief.left.follower.body[step] == (behind[-1] if behind else NOBODY)


def test_a_body_that_leans_into_the_way_counts_and_one_in_its_own_lane_does_not():
    straddling, beside = MIDDLE + 1.9, MIDDLE + 3.66
    leaning = ego_in_the_middle()
    assert believe(bodies((0, 20.0, beside, 20.0)), leaning, ROAD).leader.body[0] == NOBODY
    moved = egos(lat=MIDDLE + 0.6, lane=2)
    assert believe(bodies((0, 20.0, straddling, 20.0)), moved, ROAD).leader.body[0] == 0


def test_two_tracks_on_one_vehicle_do_not_make_the_gap_to_the_next_one_shorter_than_to_itself():
    belief = believe(bodies((0, 30.0, MIDDLE, 20.0), (0, 31.0, MIDDLE, 20.0)), ego_in_the_middle(), ROAD)
    assert belief.leaders.gap_m[0, 1] == belief.leaders.gap_m[0, 0]


def test_there_is_no_lane_beside_the_outermost():
    belief = believe(bodies((0, 20.0, 1.83, 20.0)), egos(lat=1.83, lane=3), ROAD)
    assert (belief.left.exists[0], belief.right.exists[0]) == (True, False)
    assert believe(bodies(), egos(lat=1.83, lane=3), ROAD).leader.body[0] == NOBODY


def test_a_step_without_an_ego_has_nobody_around_it():
    ego = egos(2, lon=[0.0, np.nan], lat=[MIDDLE, np.nan], lane=[2, 0])
    belief = believe(bodies((0, 20.0, MIDDLE, 20.0), (1, 20.0, MIDDLE, 20.0)), ego, ROAD)
    assert belief.leader.body.tolist() == [0, NOBODY]


FORK = graph_of(
    {
        "in": [(0, 0), (50, 0)],
        "straight": [(50, 0), (200, 0)],
        "up": [(50, 0), (60, 10), (60, 200)],
        "beside": [(0, 3.2), (50, 3.2)],
    },
    [("in", "straight"), ("in", "up")],
    [("in", "beside")],
    speed_limit_mps=13.9,
)
PLANE = LaneGraphRoad(graph=FORK)


def test_at_a_fork_the_driver_minds_the_way_that_it_takes():
    waiting = bodies((0, 60.0, 40.0, 3.0), (0, 80.0, 0.0, 3.0))
    turning = egos(2, lon=[40.0, 60.0], lat=[0.0, 20.0], lane=[1, 3], speed=10.0)
    straight_on = egos(2, lon=[40.0, 90.0], lat=[0.0, 0.0], lane=[1, 2], speed=10.0)
    assert believe(waiting, turning, PLANE).leaders.body[0].tolist() == [0, NOBODY, NOBODY]
    assert believe(waiting, straight_on, PLANE).leaders.body[0].tolist() == [1, NOBODY, NOBODY]


def test_gaps_on_a_bend_are_along_it():
    turning = egos(2, lon=[40.0, 60.0], lat=[0.0, 20.0], lane=[1, 3], speed=10.0)
    gap = believe(bodies((0, 60.0, 40.0, 3.0)), turning, PLANE).leader.gap_m[0]
    assert gap == pytest.approx(10.0 + np.hypot(10.0, 10.0) + 30.0 - LENGTH_M)


def test_the_speed_that_counts_is_that_along_the_way():
    crossing = bodies((0, 70.0, 0.0, 8.0), direction=0.5 * np.pi)
    oblique = bodies((0, 70.0, 0.0, 8.0), direction=np.pi / 3)
    unknown = bodies((0, 70.0, 0.0, 8.0), direction=np.nan)
    ego = egos(2, lon=[40.0, 90.0], lat=0.0, lane=[1, 2])
    speeds = [believe(each, ego, PLANE).leader.speed_mps[0] for each in (crossing, oblique, unknown)]
    assert speeds == pytest.approx([0.0, 4.0, 8.0])


def test_in_the_plane_the_lane_beside_has_its_own_leader_and_limits_are_known():
    belief = believe(bodies((0, 30.0, 3.2, 5.0), (0, 5.0, 3.2, 5.0)), egos(lon=20.0, lat=0.0, lane=1), PLANE)
    assert (belief.left.leader.body[0], belief.left.follower.body[0]) == (0, 1)
    assert not belief.right.exists[0]
    assert belief.speed_limit_mps[0] == 13.9


def test_what_is_far_away_in_the_plane_is_not_laid_along_the_way():
    assert believe(bodies((0, 199.0, 0.0, 3.0)), egos(lon=40.0, lat=0.0, lane=1), PLANE).leader.body[0] == NOBODY
