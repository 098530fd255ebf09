"""An ego that comes up to the crossing of ``priority``: it waits, it goes, and it creeps up for who was never seen."""

from dataclasses import replace

import numpy as np
import pytest

from harness.closedloop.beliefs import ego_of, true_bodies
from harness.closedloop.passing import Passage
from harness.decisions.belief import believe
from harness.decisions.decide import driver_of
from harness.decisions.yielding import EgoPath
from harness.scoring.metrics.closedloop import Contact
from harness.truth.network.network import load_network
from mmpf.undetected.cells import cells_of
from mmpf.undetected.intensity import Unseen
from tests.harness.closedloop.frames import frame_of

NETWORK = load_network("priority")
ROAD, GRAPH = NETWORK.road, NETWORK.road.graph
LANES = tuple(GRAPH.name.index(name) for name in ("south_in_0", ":crossing_7_0", "north_out_0"))
CELLS = cells_of(ROAD)[0]
STEP_S, EGO_MPS, OTHER_MPS = 0.2, 8.0, 16.7
MIDDLE_M = float(GRAPH.line(LANES[1]).mean(axis=0)[1])


def passage(heed=None):
    return Passage.over(GRAPH, LANES, STEP_S, heed)


STOP_M, BEGINS_M = passage().crossings[0].stop_m, passage().crossings[0].begins_m


def expecting(vehicles):
    """Return one vehicle, or none, expected 40 m before the crossing on the road that has right of way."""
    on = CELLS.lane == GRAPH.name.index("west_in_0") + 1
    place = np.where(on, np.abs(CELLS.lon_m - (MIDDLE_M - 40.0)), np.inf).argmin()
    expected = np.zeros(len(CELLS))
    expected[place] = vehicles
    return Unseen(CELLS, expected)


def frame(along_m, ego_mps, other_m, other_mps=OTHER_MPS, step=0):
    """Return the ego on its way, and a car on the road that has right of way, so far before the crossing's middle."""
    x, y, heading = (float(value[0]) for value in np.array(_place(along_m)).reshape(3, 1))
    west = GRAPH.line(GRAPH.name.index("west_in_0"))
    lane = 1 + LANES[int(np.clip(np.searchsorted(passage().route.begins_m, along_m, side="right") - 1, 0, 2))]
    there = other_m is not None
    return frame_of(
        [x, *([MIDDLE_M - other_m] if there else [])],
        [y, *([west[-1, 1]] if there else [])],
        [ego_mps, *([other_mps] if there else [])],
        step,
        ["ego", *(["other"] if there else [])],
        direction_rad=[heading, *([0.0] if there else [])],
        lane=np.array([lane, *([1] if there else [])]),
    )


def _place(along_m):
    route = passage().route
    (_,), (place,) = (values[:1] for values in route.sampled(along_m, along_m + 0.5))
    return place[0], place[1], 0.5 * np.pi


def driven(passes, other_m=None, unseen=None, seconds=12.0, told=True):
    """Drive the ego from 25 m before the stop line; return its fronts' arc lengths."""
    driver, along_m, speed, fronts = driver_of("hdm"), STOP_M - 27.0, EGO_MPS, []
    for step in range(round(seconds / STEP_S)):
        away_m = None if other_m is None else other_m - OTHER_MPS * STEP_S * step
        now = replace(frame(along_m, speed, away_m), time_s=STEP_S * step)
        ego, real = ego_of(now, LANES), true_bodies(now)
        known = real if told else true_bodies(frame(along_m, speed, None))
        course = EgoPath.of(passes.route, ego)
        holds, must = passes.room_m(course, known, unseen), passes.room_m(course, real)
        passes.note(now, course, real, holds is not None, must is not None)
        demand = driver.command(passes.with_stops(believe(known, ego, ROAD), course, holds)).accel_mps2[0]
        speed = max(0.0, speed + float(demand) * STEP_S)
        along_m += speed * STEP_S
        fronts.append(course.front_m)
    return np.array(fronts)


def test_it_waits_at_the_line_for_a_car_that_has_right_of_way_and_goes_where_there_is_none():
    now = frame(STOP_M - 27.0, EGO_MPS, 65.0)
    course = EgoPath.of(passage().route, ego_of(now))
    assert passage().room_m(course, true_bodies(now)) == pytest.approx(STOP_M - course.front_m)
    assert passage().room_m(course, true_bodies(frame(STOP_M - 27.0, EGO_MPS, None))) is None


def test_at_the_line_it_waits_for_a_car_forty_metres_off_and_past_it_before_the_place_of_conflict():
    for along_m, place_m in ((STOP_M - 5.0, STOP_M), (STOP_M - 1.0, BEGINS_M)):
        now = frame(along_m, 1.0, 40.0)
        course = EgoPath.of(passage().route, ego_of(now))
        assert passage().room_m(course, true_bodies(now)) == pytest.approx(place_m - course.front_m)


def test_who_lets_the_car_pass_crosses_behind_it():
    passes = passage()
    fronts = driven(passes, other_m=65.0)
    crossed = passes.crossed("other", None)
    assert fronts[-1] > passes.crossings[0].ends_m
    assert crossed.yielded
    assert crossed.must_hold.any()
    assert (crossed.holds == crossed.must_hold).all()
    assert crossed.encroachment_s > 1.0


def test_who_knows_nothing_of_it_goes_though_the_truth_has_it_hold():
    passes = passage()
    driven(passes, other_m=65.0, told=False, seconds=6.0)
    crossed = passes.crossed("other", None)
    assert not crossed.holds.any()
    assert crossed.must_hold.any()
    assert crossed.encroachment_s < 1.5
    assert passes.crossed("other", Contact("other", 3.0, 9.0, True)).encroachment_s == 0.0


@pytest.mark.slow
def test_an_intensity_of_zero_changes_nothing_and_of_one_it_creeps_past_the_line_up_to_the_place():
    free = driven(passage(), seconds=4.0)
    assert (driven(passage(heed=0.1), unseen=expecting(0.0), seconds=4.0) == free).all()
    assert (driven(passage(), unseen=expecting(1.0), seconds=4.0) == free).all()
    crept = driven(passage(heed=0.1), unseen=_everywhere())
    assert free[-1] > BEGINS_M
    assert STOP_M < crept[-1] < BEGINS_M
    assert crept[-1] - crept[-2] < 0.1


def _everywhere():
    on = CELLS.lane == GRAPH.name.index("west_in_0") + 1
    return Unseen(CELLS, np.where(on, 5.0 / on.sum(), 0.0))


def test_one_unseen_vehicle_forty_metres_off_holds_who_stands_before_the_place():
    now = frame(STOP_M - 27.0, EGO_MPS, None)
    near = frame(BEGINS_M - 5.0, 1.0, None)
    for at, vehicles, holds in ((near, 1.0, True), (near, 0.05, False), (now, 0.0, False)):
        course = EgoPath.of(passage().route, ego_of(at))
        room = passage(heed=0.1).room_m(course, true_bodies(at), expecting(vehicles))
        assert (room is not None) == holds
        assert not holds or room == pytest.approx(BEGINS_M - course.front_m)
