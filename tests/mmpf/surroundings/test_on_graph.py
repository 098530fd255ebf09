from dataclasses import replace

import numpy as np
import pytest

from mmpf.belief.moments import component_moments
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.motion.protocol import Surroundings
from mmpf.motion.state import LAT, LON, SPEED
from mmpf.options.filter import FilterOptions
from mmpf.scan import EgoPose
from mmpf.surroundings.on_graph import surroundings_on_graph
from mmpf.surroundings.on_road import on_road
from tests.mmpf.map.scenes import graph_of
from tests.mmpf.scenes import ROAD, belief_of

LENGTH_M = 4.0


def street() -> LaneGraph:
    """Two lanes east, one back west, and a fork at the right lane's end: straight on or to the right."""
    lines = {
        "right": [(0, 0), (100, 0)],
        "left": [(0, 3.2), (100, 3.2)],
        "back": [(100, 6.4), (0, 6.4)],
        "on": [(100, 0), (200, 0)],
        "off": [(100, 0), (100, -80)],
    }
    return graph_of(lines, [("right", "on"), ("right", "off")], beside=[("right", "left")])


EGO = ("back", 99.0)


def around(
    vehicles: list[tuple[str, float, float, str | None]],
    gate: float = 0.0,
    chance: float = 1.0,
    last_left_m: float = 0.0,
) -> Surroundings:
    """Surroundings of vehicles (lane, arc length, speed, next lane), each of one particle; the last to the left."""
    graph = street()
    lane = np.array([graph.name.index(name) for name, *_ in vehicles])
    following = [NOWHERE if to is None else graph.name.index(to) for *_, to in vehicles]
    state = np.zeros((6, len(vehicles)))
    left = np.append(np.zeros(len(lane) - 1), last_left_m)
    state[LON], state[LAT], heading = graph.place(lane, np.array([v[1] for v in vehicles]), left)
    state[SPEED] = [v[2] for v in vehicles]
    latents = np.stack([np.full(len(lane), gate), lane, np.array(following), heading])
    columns = {"existence": [1.0] * len(lane), "confirmed": [True] * len(lane), "length_m": [LENGTH_M] * len(lane)}
    mixture = belief_of(np.split(state, len(lane), axis=1), **columns)
    mixture = replace(mixture, cloud=replace(mixture.cloud, latents=latents), has_headings=True)
    x, y, turn = graph.place(np.array([graph.name.index(EGO[0])]), np.array([EGO[1]]), np.zeros(1))
    pose = EgoPose(float(x[0]), float(y[0]), float(turn[0]), 7.0, LENGTH_M, 1.9)
    seen = np.ones(len(lane), dtype=bool)
    moments, links = component_moments(mixture), np.full(len(graph.successor), chance)
    return surroundings_on_graph(mixture, moments, seen, pose, 0.0, graph, lambda _: links)


def test_settings_of_the_plane_apply_on_lane_graphs_and_not_on_one_road() -> None:
    plane = {"in_view_per_s": 0.5, "shading": (0.2, 0.3, 0.5), "confirm_above": 0.4}
    options = FilterOptions.model_validate({"joint": {"plane": plane}})
    found = on_road(LaneGraphRoad(street())).options(options).joint
    assert [found.newborn.in_view_per_s, found.vehicles.shading, found.kinds.confirm_above] == list(plane.values())
    assert on_road(ROAD).options(options) == options


def test_the_leader_is_the_next_vehicle_in_the_lane_and_nobody_behind_or_oncoming() -> None:
    found = around([("right", 20, 10, "on"), ("right", 50, 8, "on"), ("right", 5, 9, "on"), ("back", 70, 9, None)])
    assert found.leader.exists.tolist() == [True, False, True, True]
    assert found.leader.gap_m[:1] == pytest.approx([30.0 - LENGTH_M])
    assert found.leader.speed_mps[[0, 2]] == pytest.approx([8.0, 10.0])
    assert found.leader.speed_mps[3] == pytest.approx(7.0), "the ego is somebody's leader too"


def test_the_leader_beyond_the_lanes_end_is_on_the_way_that_the_particle_means_to_take() -> None:
    found = around([("right", 80, 10, "on"), ("right", 90, 9, "off"), ("on", 30, 5, None), ("off", 15, 4, None)])
    assert found.leader.speed_mps[:2] == pytest.approx([9.0, 4.0])
    assert found.leader.gap_m[1] == pytest.approx(10.0 + 15.0 - LENGTH_M)
    alone = around([("right", 80, 10, "on"), ("on", 30, 5, None), ("off", 15, 4, None)])
    assert alone.leader.gap_m[0] == pytest.approx(20.0 + 30.0 - LENGTH_M)


@pytest.mark.parametrize("left_m", [-3.6, 3.6])
def test_who_stands_beside_a_lane_that_follows_leads_nobody(left_m: float) -> None:
    vehicles = [("right", 80, 10, "on"), ("on", 30, 5, None), ("on", 10, 0, None)]
    found = around(vehicles, last_left_m=left_m)
    assert (found.leader.speed_mps[0], found.leader.gap_m[0]) == pytest.approx((5.0, 20.0 + 30.0 - LENGTH_M))
    assert around(vehicles, last_left_m=0.5).leader.speed_mps[0] == 0.0, "half a metre off the middle it is in the way"


def test_in_the_lane_beside_there_are_a_leader_and_a_follower() -> None:
    found = around([("right", 50, 10, "on"), ("left", 70, 12, None), ("left", 20, 13, None)])
    assert found.has_left_lane.tolist() == [True, False, False]
    assert found.has_right_lane.tolist() == [False, True, True]
    assert (found.left_leader.speed_mps[0], found.left_follower.speed_mps[0]) == (12.0, 13.0)
    assert (found.left_leader.gap_m[0], found.left_follower.gap_m[0]) == (pytest.approx(16.0), pytest.approx(26.0))
    assert found.right_leader.exists.tolist() == [False, False, True]


def test_lane_lines_are_half_a_width_off() -> None:
    found = around([("right", 50, 10, "on"), ("left", 52, 14, None), ("back", 45, 3, None)])
    assert found.lane_left_m == pytest.approx([1.6] * 3)
    assert found.lane_right_m == pytest.approx([-1.6] * 3)


def before_closed_link(along_m: float, speed_mps: float, gate: float, chance: float) -> Surroundings:
    """Surroundings of one vehicle on the right lane that means to go on, by a link that is open by chance."""
    return around([("right", along_m, speed_mps, "on")], gate=gate, chance=chance)


def test_who_takes_the_link_ahead_for_closed_has_a_standing_leader_at_the_line() -> None:
    found = before_closed_link(50.0, 10.0, gate=0.7, chance=0.5)
    assert found.leader.exists.tolist() == [True]
    assert found.leader.speed_mps.tolist() == [0.0]
    # A car that stops so that 2 m are left to that leader stands a metre before the line.
    assert found.leader.gap_m == pytest.approx([50.0 - 0.5 * LENGTH_M + 1.0])


def test_who_takes_it_for_open_or_can_no_longer_stop_goes_on() -> None:
    assert not before_closed_link(50.0, 10.0, gate=0.3, chance=0.5).leader.exists.any()
    assert not before_closed_link(90.0, 12.0, gate=0.7, chance=0.5).leader.exists.any()
