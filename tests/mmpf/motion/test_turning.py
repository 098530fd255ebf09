"""Driving by the map: how fast the road can be driven, and who drives by it."""

from dataclasses import replace

import numpy as np
import pytest

from mmpf.map.control import FREE, NO_SIGNAL, YIELD, LinkControl
from mmpf.map.lane_graph import NO_LIMIT_MPS, NOWHERE, without_map
from mmpf.motion.learned.driver import DESIRED_SPEED, FADES_IN_S, PACE, LearnedDriver, residual_driver
from mmpf.motion.off_map import in_plane
from mmpf.motion.state import ACCEL, SPEED
from mmpf.motion.turning import TurningDriver, lane_speeds, road_speeds, turning_driver
from mmpf.options.filter import FilterOptions
from mmpf.scan import SensorModel
from mmpf.tracker import RULES
from tests.mmpf.map.scenes import arc, graph_of
from tests.mmpf.motion.surroundings import around, states, vehicle

DRIVER = TurningDriver(
    turning_mps2=2.0, slowing_mps2=1.5, looking_mps=3.0, strongest_mps2=1.2, pace=1.0, pace_spread=0.1
)


def approach_and_turn(*, gives_way: bool = False):
    """Return 100 m of straight lane that end in a turn of 8 m radius."""
    lines = {"road": [(0.0, 0.0), (100.0, 0.0)], "turn": arc(8.0, np.pi / 2, 200) + np.array([100.0, 0.0])}
    graph = graph_of(lines, links=[("road", "turn")], in_junction=("turn",), speed_limit_mps=14.0)
    kind = np.array([YIELD if gives_way else FREE])
    nobody = np.zeros(0, dtype=np.int64)
    return replace(graph, control=LinkControl(kind, np.array([NO_SIGNAL]), (), nobody, np.zeros(2, dtype=np.int64)))


def test_a_turn_is_driven_with_the_lateral_acceleration_and_a_road_at_its_limit() -> None:
    assert lane_speeds(approach_and_turn(), DRIVER) == pytest.approx([14.0, np.sqrt(2.0 * 8.0)], rel=1e-2)


def test_where_no_limit_is_known_only_the_turn_says_how_fast_the_road_is_driven() -> None:
    graph = approach_and_turn()
    graph.speed_limit_mps[:] = NO_LIMIT_MPS
    assert lane_speeds(graph, DRIVER) == pytest.approx([np.inf, 4.0], rel=1e-2)


def test_before_a_turn_the_speed_falls_as_gentle_braking_makes_it_fall() -> None:
    graph, lane = approach_and_turn(), np.zeros(3, dtype=np.int64)
    speed = road_speeds(graph, lane, lane + 1, np.array([0.0, 80.0, 100.0]), DRIVER)
    assert speed == pytest.approx([14.0, np.sqrt(16.0 + 2 * 1.5 * 20.0), 4.0], rel=1e-2)


def test_who_goes_another_way_or_is_on_no_lane_is_not_slowed_by_the_turn() -> None:
    lane, nowhere = np.array([0, NOWHERE]), np.full(2, NOWHERE)
    assert road_speeds(approach_and_turn(), lane, nowhere, np.full(2, 95.0), DRIVER).tolist() == [14.0, np.inf]


def test_a_line_where_others_have_right_of_way_is_come_to_slowly() -> None:
    graph, lane = approach_and_turn(gives_way=True), np.zeros(1, dtype=np.int64)
    assert road_speeds(graph, lane, lane + 1, np.array([100.0]), DRIVER) == pytest.approx([3.0])


def test_who_stands_on_a_free_road_sets_out_and_comes_to_the_roads_speed() -> None:
    model, rng, state = LearnedDriver(changes_lanes=False), np.random.default_rng(0), states(400, speed_mps=0.0)
    on_map = replace(around(state), road_speed_mps=np.full(400, 12.0))
    latents = model.draw_latents(state, rng)
    for _ in range(300):
        state, latents = model.propagate(state, latents, on_map, 0.1, rng)
    pace = turning_driver().pace
    assert np.quantile(state[SPEED], 0.9) == pytest.approx(12.0 * pace, abs=2.0)
    assert state[SPEED].max() < 12.0 * pace * 1.5


def test_who_drove_by_the_road_and_loses_it_goes_on_as_it_does() -> None:
    model, rng, state = LearnedDriver(changes_lanes=False), np.random.default_rng(0), states(400, speed_mps=12.0)
    latents = model.draw_latents(state, rng)
    on_map = replace(around(state, hidden=True), road_speed_mps=np.full(400, 12.0))
    state, latents = model.propagate(state, latents, on_map, 0.1, rng)
    for _ in range(50):
        state, latents = model.propagate(state, latents, around(state, hidden=True), 0.1, rng)
    by_road = ~np.isfinite(latents[DESIRED_SPEED])
    assert by_road.mean() == pytest.approx(0.5, abs=0.1)
    assert state[SPEED, by_road].mean() == pytest.approx(12.0, abs=0.5)


def test_where_nothing_is_known_of_the_road_nobody_drives_by_it() -> None:
    model, state = LearnedDriver(changes_lanes=False), states(50)
    latents = model.draw_latents(state, np.random.default_rng(0))
    after, drawn = model.propagate(state, latents, around(state), 0.1, np.random.default_rng(1))
    assert np.isfinite(drawn[DESIRED_SPEED]).all()
    assert (drawn[PACE] == 1.0).all()
    assert np.isfinite(after).all()


def without_limits(speed_mps: float, accel_mps2: float, seconds: float, *, road_mps: float = np.inf, leader=None):
    """Return the speeds of 4000 hidden drivers who know of no limit, after so many seconds."""
    model, rng = residual_driver().without_limits(), np.random.default_rng(0)
    state = states(4000, speed_mps)
    state[ACCEL] = accel_mps2
    latents = model.draw_latents(state, rng)
    for _ in range(round(seconds / 0.1)):
        seen = replace(around(state, leader, hidden=True), road_speed_mps=np.full(4000, road_mps))
        state, latents = model.propagate(state, latents, seen, 0.1, rng)
    return state[SPEED]


@pytest.mark.parametrize("accel_mps2", [-1.0, 0.0, 1.0])
def test_where_no_limit_is_known_acceleration_fades_by_its_time_constant(accel_mps2: float) -> None:
    seconds, scale_s = 3.0, FADES_IN_S
    gained = accel_mps2 * scale_s * -np.expm1(-seconds / scale_s)
    assert without_limits(15.0, accel_mps2, seconds).mean() == pytest.approx(15.0 + gained, abs=0.1)


def test_where_no_limit_is_known_a_road_slows_down_and_draws_nobody() -> None:
    assert without_limits(10.0, 0.0, 3.0, road_mps=20.0).mean() == pytest.approx(10.0, abs=0.1)
    assert without_limits(10.0, 0.0, 3.0, road_mps=6.0).mean() < 8.5


def test_where_no_limit_is_known_only_a_near_leader_says_how_fast_to_go() -> None:
    assert without_limits(10.0, 0.0, 3.0, leader=vehicle(4000, 60.0, 20.0)).mean() == pytest.approx(10.0, abs=0.1)
    assert without_limits(10.0, 0.0, 3.0, leader=vehicle(4000, 15.0, 2.0)).mean() < 8.0


def test_only_a_map_that_states_a_limit_tells_drivers_what_speed_they_desire() -> None:
    known, driver = approach_and_turn(), residual_driver()
    unknown = replace(known, speed_limit_mps=np.full(len(known), NO_LIMIT_MPS))
    for motion in (driver, RULES["joint"](FilterOptions(), SensorModel()).motion(driver)):
        moved = [in_plane(motion, graph).inner for graph in (known, unknown, without_map())]
        assert [getattr(inner, "inner", inner).goes_on for inner in moved] == [False, True, True]
