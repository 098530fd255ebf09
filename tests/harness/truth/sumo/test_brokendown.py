"""Vehicles that have broken down: where they stand, that the others pass them, and that without any nothing changes."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.config.layers import config_from_table
from harness.running.resolve import resolve_run_config
from harness.truth.network.network import load_network
from harness.truth.sumo.brokendown import clear_of, place_broken_down
from harness.truth.sumo.corridor_traffic import choose_ego
from harness.truth.sumo.fill import Placement
from harness.truth.sumo.simulation import NO_EGO
from tests.harness.closedloop.frames import frame_of
from tests.harness.truth.sumo.test_simulation import drive

US101 = load_network("us101")
LANES, SECTION_M = (0.0, 18.3), (0.0, 640.0)


@pytest.fixture(scope="module")
def frames():
    return drive(demand=15.0, duration_s=25.0, seed=3, broken_down=1)


def broken_row(frame):
    (row,) = np.flatnonzero(frame.vehicle_id == "broken0")
    return int(row)


@pytest.mark.slow
def test_it_stands_at_one_place_on_a_main_lane_of_the_section_in_every_frame_and_never_is_the_ego(frames):
    places = {(float(frame.lon_m[row]), float(frame.lat_m[row])) for frame in frames for row in [broken_row(frame)]}
    assert len(places) == 1
    ((lon_m, lat_m),) = places
    assert SECTION_M[0] + 100.0 < lon_m < SECTION_M[1] - 100.0
    assert LANES[0] < lat_m < LANES[1]
    assert all(frame.speed_mps[broken_row(frame)] == 0.0 for frame in frames)
    assert all(frame.ego != broken_row(frame) for frame in frames)


@pytest.mark.slow
def test_who_comes_along_its_lane_steers_around_it_and_nobody_drives_through(frames):
    came, passed = set(), set()
    for frame in frames:
        row = broken_row(frame)
        ahead_m, across_m = frame.lon_m - frame.lon_m[row], np.abs(frame.lat_m - frame.lat_m[row])
        others = frame.vehicle_id != "broken0"
        came |= set(frame.vehicle_id[others & (across_m < 1.0) & (np.abs(ahead_m + 85.0) < 65.0)].tolist())
        passed |= set(frame.vehicle_id[others & (ahead_m > 10.0)].tolist())
        touches = np.abs(ahead_m) < 0.5 * (frame.length_m + frame.length_m[row])
        touches &= across_m < 0.5 * (frame.width_m + frame.width_m[row])
        assert not (touches & others).any()
    assert came & passed


@pytest.mark.slow
def test_the_ego_of_a_minute_passes_it():
    frames = drive(broken_down=1, demand=10.0, duration_s=35.0, seed=4)
    first = frames[0].vehicle_id[frames[0].ego]
    gaps = [float(f.lon_m[broken_row(f)] - f.lon_m[f.ego]) for f in frames if f.vehicle_id[f.ego] == first]
    assert gaps[0] > 50.0
    assert gaps[-1] < 0.0


def test_without_any_the_traffic_is_the_same_as_if_there_were_no_such_option():
    asked, unasked = drive(demand=8.0, duration_s=1.0, broken_down=0), drive(demand=8.0, duration_s=1.0)
    assert all(np.array_equal(a.lon_m, b.lon_m) for a, b in zip(asked, unasked, strict=True))
    assert resolve_run_config(None, {}).as_table() == resolve_run_config(None, {"broken_down": 0}).as_table()
    assert "broken_down" not in resolve_run_config(None, {}).as_table()["traffic"]
    assert resolve_run_config(None, {"broken_down": 2}).as_table()["traffic"]["broken_down"] == 2


@pytest.mark.parametrize("count", [1, 2, 5, 9])
def test_each_has_a_part_of_the_section_to_itself_and_those_that_follow_stand_in_other_lanes(count):
    placements = place_broken_down(US101, count, 5)
    edges = {edge.name: edge for edge in US101.main_road.edges}
    front_m = [edges[each.edge].start_m + each.position_m for each in placements]
    lane = [each.lane_index - edges[each.edge].extra_lanes for each in placements]
    assert len(placements) == count
    assert front_m == sorted(front_m)
    assert all(SECTION_M[0] < place_m < SECTION_M[1] for place_m in front_m)
    assert all(0 <= each < 5 for each in lane)
    assert all(a != b for a, b in pairwise(lane))
    assert placements == place_broken_down(US101, count, 5)
    assert placements != place_broken_down(US101, count, 6)


def test_nobody_is_put_on_the_road_who_could_not_stop_behind_it():
    (broken,) = place_broken_down(US101, 1, 5)

    def at(ahead_m, lane=0):
        return Placement(
            broken.vehicle, broken.edge, broken.lane_index + lane, broken.position_m + ahead_m, 20.0, broken.route
        )

    there = [at(-70.0), at(-50.0), at(-3.0), at(5.0), at(30.0), at(-3.0, lane=1)]
    assert clear_of(there, [broken]) == [there[0], there[4], there[5]]
    assert clear_of(there, []) == there


@pytest.mark.parametrize(
    ("network", "count", "said"),
    [
        (US101, 10, r"`broken_down` 10: .* room for 9"),
        (load_network("junction"), 1, "`broken_down`: junction has no main road"),
        (replace(US101, corridor=replace(US101.main_road, main_lanes=1)), 1, "one main lane"),
    ],
)
def test_where_none_can_stand_one_line_says_so(network, count, said):
    with pytest.raises(InputError, match=said):
        place_broken_down(network, count, 0)


def test_recorded_traffic_has_none_and_says_so():
    with pytest.raises(InputError, match="leave broken_down out"):
        config_from_table({"traffic": {"broken_down": 1, "recording": {"format": "ngsim"}}})
    with pytest.raises(InputError, match="broken_down"):
        resolve_run_config(None, {"broken_down": -1})


def test_the_ego_is_another_car_even_where_it_is_the_only_one_near_the_start():
    frame = frame_of([20.0, 300.0], [1.8, 1.8], names=["broken0", "car1"])
    assert choose_ego(frame, NO_EGO, (1, 2), SECTION_M) == 1
