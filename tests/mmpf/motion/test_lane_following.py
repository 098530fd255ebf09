import numpy as np
import pytest

from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.motion.lane_following import (
    HEADING,
    LANE,
    LEAVES_PER_S,
    LOOKS_AROUND,
    NEXT,
    ON_NO_LANE,
    TURNING_STD,
    LaneFollowing,
)
from mmpf.motion.protocol import Memoryless, Neighbour, Surroundings
from mmpf.motion.state import LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray
from mmpf.scan import BodyHeadings
from tests.mmpf.map.scenes import arc, graph_of


def glide(state: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator) -> FloatArray:
    """Go on with the speeds that there are, exactly."""
    del surroundings, rng
    moved = state.copy()
    moved[LON] += dt_s * state[SPEED]
    moved[LAT] += dt_s * state[LAT_SPEED]
    return moved


class Drive:
    """Particles that glide along a graph."""

    def __init__(self, graph: LaneGraph, lane: list[str], along_m: list[float], speed_mps: float, left_m: float = 0.0):
        self.motion, self.graph = LaneFollowing(Memoryless("glide", glide), graph), graph
        index = np.array([graph.name.index(name) for name in lane])
        self.state = np.zeros((6, len(lane)))
        offset = np.full(len(lane), left_m)
        self.state[LON], self.state[LAT], heading = graph.place(index, np.array(along_m, dtype=float), offset)
        self.state[SPEED] = speed_mps
        self.latents = np.stack([np.zeros(len(lane)), index.astype(float), np.full(len(lane), float(NOWHERE)), heading])
        first = graph.first_successor
        for n, k in enumerate(index):
            if first[k + 1] > first[k]:
                self.latents[NEXT, n] = graph.successor[first[k]]
        self.rng = np.random.default_rng(0)

    def go(self, steps: int, dt_s: float = 0.1, *, in_sight: bool = False) -> None:
        nobody = Neighbour(*(np.zeros(0) for _ in range(5)))  # type: ignore[arg-type]
        nothing = np.zeros(0)
        hidden = np.full(self.state.shape[1], not in_sight)
        around = Surroundings(*(nothing,) * 5, *(nobody,) * 5, hidden, nothing)  # type: ignore[arg-type]
        for _ in range(steps):
            self.state, self.latents = self.motion.propagate(self.state, self.latents, around, dt_s, self.rng)

    @property
    def lanes(self) -> list[str]:
        return [self.graph.name[int(k)] if k >= 0 else "none" for k in self.latents[LANE]]


def test_round_a_bend_a_vehicle_goes_as_far_as_its_speed_takes_it_along_the_bend() -> None:
    drive = Drive(graph_of({"bend": arc(60.0, np.pi / 2, 600)}), ["bend"] * 2, [5.0, 20.0], 8.0)
    drive.go(50)
    angle = np.array([45.0, 60.0]) / 60.0
    assert drive.state[LON] == pytest.approx(60.0 * np.sin(angle), abs=0.02)
    assert drive.state[LAT] == pytest.approx(60.0 * (1.0 - np.cos(angle)), abs=0.02)
    assert drive.latents[HEADING] == pytest.approx(angle, abs=0.01)


def test_oncoming_traffic_has_a_positive_speed_and_goes_the_other_way() -> None:
    graph = graph_of({"there": [(0, 0), (100, 0)], "back": [(100, 3), (0, 3)]})
    drive = Drive(graph, ["there", "back"], [20, 20], 10.0)
    drive.go(10)
    assert drive.state[LON] == pytest.approx([30.0, 70.0])
    assert drive.state[LAT] == pytest.approx([0.0, 3.0])
    assert (drive.state[SPEED] == 10.0).all()


def fork() -> LaneGraph:
    lines = {"in": [(0, 0), (50, 0)], "straight": [(50, 0), (120, 0)], "left": np.add(arc(20.0, np.pi / 2), [50, 0])}
    return graph_of(lines, [("in", "straight"), ("in", "left")], in_junction=("left",))


def test_at_a_fork_the_particles_part_and_each_way_gets_its_share() -> None:
    drive = Drive(fork(), ["in"] * 4000, [0.0] * 4000, 5.0)
    drive.go(160)
    taken = np.array(drive.lanes)
    assert set(taken) == {"straight", "left"}
    assert 0.4 < np.mean(taken == "left") < 0.6
    assert drive.state[LAT, taken == "straight"] == pytest.approx(0.0, abs=1e-9)
    assert drive.state[LON, taken == "left"] == pytest.approx(50.0 + 20.0 * np.sin(30.0 / 20.0), abs=0.1)


def test_in_the_junction_nobody_changes_its_way() -> None:
    drive = Drive(fork(), ["left"] * 200, [1.0] * 200, 2.0)
    drive.go(50)
    assert set(drive.lanes) == {"left"}


def test_past_the_middle_line_a_vehicle_is_in_the_lane_beside() -> None:
    lines = {"right": [(0, 0), (100, 0)], "left": [(0, 3.2), (100, 3.2)]}
    drive = Drive(graph_of(lines, beside=[("right", "left")]), ["right"], [10.0], 10.0)
    drive.state[LAT_SPEED] = 1.0
    drive.go(15)
    assert drive.lanes == ["right"]
    drive.go(2)
    assert drive.lanes == ["left"]
    assert drive.state[LON] == pytest.approx([27.0])
    assert drive.state[LAT] == pytest.approx([1.7])


def test_before_a_slower_lane_one_has_slowed_down() -> None:
    graph = graph_of({"fast": [(0, 0), (100, 0)], "slow": [(100, 0), (150, 0)]}, [("fast", "slow")])
    graph.speed_limit_mps[1] = 5.0
    drive = Drive(graph, ["fast"], [50.0], 14.0)
    while drive.lanes == ["fast"]:
        drive.go(1)
    assert drive.state[SPEED] == pytest.approx([1.3 * 5.0], abs=0.5)


def test_newborn_vehicles_take_the_lanes_beside_them_in_every_direction_and_none_where_there_is_none() -> None:
    lines = {"there": [(0, 0), (100, 0)], "back": [(100, 2), (0, 2)], "across": [(50, -40), (50, 40)]}
    motion = LaneFollowing(Memoryless("glide", glide), graph_of(lines))
    state = np.zeros((6, 3000))
    state[LON], state[LAT] = np.repeat([20.0, 50.0, 20.0], 1000), np.repeat([1.0, 1.0, 30.0], 1000)
    latents = motion.draw_latents(state, np.random.default_rng(0))
    beside, crossing, nowhere = latents[:, :1000], latents[:, 1000:2000], latents[:, 2000:]
    assert np.mean(beside[LANE] == 0) == pytest.approx(0.5, abs=0.06)
    assert set(beside[LANE]) == {0.0, 1.0, NOWHERE}
    assert set(crossing[LANE]) == {0.0, 1.0, 2.0, NOWHERE}
    assert np.abs(np.cos(beside[HEADING, beside[LANE] != NOWHERE])) == pytest.approx(1.0)
    assert set(nowhere[LANE]) == {float(NOWHERE)}
    assert nowhere[HEADING].min() < -3.0 < 3.0 < nowhere[HEADING].max()


def test_off_every_lane_a_vehicle_goes_as_it_points_and_turns_by_chance() -> None:
    drive = Drive(graph_of({"there": [(0, 0), (100, 0)]}), ["there"] * 4000, [50.0] * 4000, 6.0)
    drive.latents[LANE], drive.latents[HEADING] = NOWHERE, 0.5 * np.pi
    drive.state[LAT] = 20.0
    drive.go(10)
    assert (drive.state[LON].mean(), drive.state[LAT].mean()) == (
        pytest.approx(50.0, abs=0.05),
        pytest.approx(26.0, abs=0.1),
    )
    # Noise of so much lateral speed per root second turns it by this per root second, tightest bends cut off.
    assert 0.9 * TURNING_STD / 6.0 < drive.latents[HEADING].std() < TURNING_STD / 6.0
    assert set(drive.lanes) == {"none"}


def test_a_few_particles_of_a_vehicle_in_sight_leave_their_lane_so_that_the_map_can_be_wrong() -> None:
    shares = []
    for in_sight in (True, False):
        drive = Drive(graph_of({"there": [(0, 0), (400, 0)]}), ["there"] * 40_000, [50.0] * 40_000, 6.0)
        drive.go(1, in_sight=in_sight)
        shares.append(np.mean(np.array(drive.lanes) == "none"))
    back = LOOKS_AROUND / (1.0 + ON_NO_LANE)
    assert shares == [pytest.approx(0.1 * LEAVES_PER_S * (1.0 - back), rel=0.25), 0.0]


@pytest.mark.parametrize("dt_s", [0.05, 0.1, 0.2])
def test_as_many_find_back_to_a_lane_within_a_time_at_any_length_of_the_step(dt_s: float) -> None:
    drive = Drive(graph_of({"there": [(0, 0), (400, 0)]}), ["there"] * 20_000, [50.0] * 20_000, 6.0)
    drive.latents[LANE] = NOWHERE
    drive.go(round(0.4 / dt_s), dt_s)
    looked = 1.0 - (1.0 - LOOKS_AROUND) ** 4
    assert np.mean(np.array(drive.lanes) == "there") == pytest.approx(looked / (1.0 + ON_NO_LANE), abs=0.02)


def test_a_vehicle_far_from_the_middle_of_the_only_lane_is_often_born_on_none() -> None:
    motion, state = (
        LaneFollowing(Memoryless("glide", glide), graph_of({"there": [(0, 0), (100, 0)]})),
        np.zeros((6, 9000)),
    )
    state[LON], state[LAT] = 50.0, np.repeat([0.0, 2.0, 4.0], 3000)
    on_none = (motion.draw_latents(state, np.random.default_rng(0))[LANE] == NOWHERE).reshape(3, -1).mean(axis=1)
    beside = np.exp(-0.5 * np.array([0.0, 2.0, 4.0]) ** 2)
    assert on_none == pytest.approx(ON_NO_LANE / (ON_NO_LANE + beside), abs=0.03)


def test_particles_born_with_a_direction_stay_on_lanes_that_lead_there_and_point_there_off_lanes() -> None:
    east = np.array([[0.0, 0.0], [100.0, 0.0]])
    graph = graph_of({"there": east, "back": east[::-1] + np.array([0.0, 3.5])})
    drive = Drive(graph, ["there"] * 1000 + ["back"] * 1000, [50.0] * 2000, 10.0)
    drive.latents[LANE, ::2] = NOWHERE
    measured = BodyHeadings(np.array([0.1]), np.array([0.02]), np.zeros(1))
    latents = drive.motion.towards(drive.latents, measured, drive.rng)
    on_lane = latents[LANE] != NOWHERE
    assert on_lane[1:1000:2].all()
    # One measured direction of twenty has nothing to do with the vehicle's.
    assert on_lane[1001::2].mean() == pytest.approx(0.05, abs=0.03)
    assert (np.abs(latents[HEADING, ~on_lane] - 0.1) < 0.1).mean() == pytest.approx(0.97, abs=0.03)
    assert latents[HEADING, on_lane] == pytest.approx(np.where(latents[LANE, on_lane] == 0, 0.0, np.pi))
    assert (latents[NEXT, ~on_lane] == NOWHERE).all()


def test_nobody_makes_up_its_mind_to_a_turn_that_it_is_too_fast_for() -> None:
    lines = {"road": [(0.0, 0.0), (100.0, 0.0)], "on": [(100.0, 0.0), (130.0, 0.0)], "turn": arc(6.0, np.pi / 2, 100)}
    lines["turn"] = np.asarray(lines["turn"]) + np.array([100.0, 0.0])
    graph = graph_of(lines, [("road", "on"), ("road", "turn")], in_junction=("on", "turn"))
    for speed, some_turn in ((14.0, False), (4.0, True)):
        drive = Drive(graph, ["road"] * 400, [90.0] * 400, speed)
        drive.latents[NEXT] = 1.0
        drive.go(4)
        assert (drive.latents[NEXT] == 2.0).any() == some_turn


def test_who_stands_on_a_lane_goes_on_standing_and_starts_after_a_while() -> None:
    def pull_away(state: FloatArray, surroundings: Surroundings, dt_s: float, rng: np.random.Generator) -> FloatArray:
        moved = glide(state, surroundings, dt_s, rng)
        moved[SPEED] += 5.0 * dt_s
        moved[LON] += 2.5 * dt_s**2
        return moved

    graph = graph_of({"bend": arc(60.0, np.pi / 2, 600)})
    drive = Drive(graph, ["bend"] * 4000, [20.0] * 4000, 0.0, left_m=0.8)
    drive.motion = LaneFollowing(Memoryless("pull away", pull_away), graph)
    before = drive.state.copy()
    drive.go(10)
    stands = drive.state[SPEED] == 0.0
    still = (drive.state[[LON, LAT]] == before[[LON, LAT]]).all(axis=0)
    assert (still == stands).all()
    assert stands.mean() == pytest.approx(np.exp(-0.5), abs=0.03)
