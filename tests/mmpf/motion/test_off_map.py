"""Without a map a vehicle goes where it points, and its drift turns it."""

import numpy as np
import pytest

from mmpf.map.lane_graph import NOWHERE, without_map
from mmpf.motion.heading_measurements import heading_ratio
from mmpf.motion.kinematic import ProcessNoise, kinematic
from mmpf.motion.lane_following import HEADING, LANE, NEXT, LaneFollowing
from mmpf.motion.off_map import OffMapMotion, in_plane
from mmpf.motion.protocol import Memoryless, Neighbour, Surroundings
from mmpf.motion.state import LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray, wrapped
from mmpf.scan import BodyHeadings
from tests.mmpf.map.scenes import arc, graph_of

NOBODY = Neighbour(*(np.zeros(0) for _ in range(5)))  # type: ignore[arg-type]
AROUND = Surroundings(*(np.zeros(0),) * 5, *(NOBODY,) * 5, *(np.zeros(0),) * 2)  # type: ignore[arg-type]
RNG = np.random.default_rng(0)


def drifting(rate_mps2: float) -> OffMapMotion:
    """Return a motion that goes on with its speed and drifts to the left the faster the longer it goes."""

    def step(state: FloatArray, around: Surroundings, dt_s: float, rng: np.random.Generator) -> FloatArray:
        del around, rng
        moved = state.copy()
        moved[LON] += dt_s * state[SPEED]
        moved[LAT_SPEED] += dt_s * rate_mps2
        return moved

    return OffMapMotion(Memoryless("drifting", step))


def driven(
    motion: OffMapMotion, heading_rad: list[float], speed_mps: float, steps: int
) -> tuple[FloatArray, FloatArray]:
    state = np.zeros((6, len(heading_rad)))
    state[SPEED] = speed_mps
    latents = motion.draw_latents(state, RNG)
    latents[HEADING] = heading_rad
    for _ in range(steps):
        state, latents = motion.propagate(state, latents, AROUND, 0.1, RNG)
    return state, latents


def test_a_vehicle_goes_where_it_points() -> None:
    state, latents = driven(drifting(0.0), [0.0, np.pi / 2, -2.0], 8.0, 50)
    assert state[LON] == pytest.approx(40.0 * np.cos([0.0, np.pi / 2, -2.0]), abs=1e-9)
    assert state[LAT] == pytest.approx(40.0 * np.sin([0.0, np.pi / 2, -2.0]), abs=1e-9)
    assert latents[HEADING] == pytest.approx([0.0, np.pi / 2, -2.0])
    assert (state[SPEED] == 8.0).all()


def test_a_steady_sideways_acceleration_drives_a_circle() -> None:
    radius_m, speed_mps = 20.0, 5.0
    state, latents = driven(drifting(speed_mps**2 / radius_m), [0.0], speed_mps, 50)
    turned = 50 * 0.1 * speed_mps / radius_m
    assert latents[HEADING] == pytest.approx([turned], rel=0.02)
    assert state[LON] == pytest.approx([radius_m * np.sin(turned)], abs=1.0)
    assert state[LAT] == pytest.approx([radius_m * (1.0 - np.cos(turned))], abs=1.0)


def test_who_stands_does_not_turn() -> None:
    _, latents = driven(drifting(1.0), [0.3], 0.0, 20)
    assert latents[HEADING] == pytest.approx([0.3])


def test_sideways_noise_turns_vehicles_and_adds_nothing_to_their_speed() -> None:
    motion = OffMapMotion(kinematic("csaa", ProcessNoise(0.0, 0.0)))
    state, rng = np.zeros((6, 500)), np.random.default_rng(4)
    state[SPEED, 250:] = 10.0
    latents = motion.draw_latents(state, rng)
    latents[HEADING] = 0.0
    for _ in range(30):
        state[LAT_SPEED] += 0.3 * rng.standard_normal(500)
        state, latents = motion.propagate(state, latents, AROUND, 0.1, rng)
    assert np.abs(state[[LON, LAT, SPEED], :250]).max() == pytest.approx(0.0, abs=1e-9)
    assert state[SPEED, 250:] == pytest.approx(np.full(250, 10.0), rel=1e-6)
    assert latents[HEADING, 250:].std() == pytest.approx(0.03 * np.sqrt(30), rel=0.15)


def test_without_lanes_vehicles_turn_by_noise_over_their_speed() -> None:
    motion = OffMapMotion(drifting(0.0).inner, turning_std=1.2)
    _, latents = driven(motion, [0.0] * 2000, 10.0, 10)
    assert latents[HEADING].std() == pytest.approx(1.2 / 10.0, rel=0.07)


def test_what_stands_drifts_by_the_root_of_time_and_neither_turns_nor_speeds_up() -> None:
    inner = kinematic("csaa", ProcessNoise(0.0, 0.0))
    state, latents = driven(OffMapMotion(inner, turning_std=1.2, drift_std=0.1), [0.3] * 2000, 0.0, 40)
    assert state[[LON, LAT]].std(axis=1) == pytest.approx([0.1 * np.sqrt(4.0 * np.exp(-0.05))] * 2, rel=0.07)
    assert (state[SPEED] == 0.0).all()
    assert latents[HEADING] == pytest.approx([0.3] * 2000)


def test_newborn_particles_are_on_no_lane_and_point_anywhere() -> None:
    motion = drifting(0.0)
    latents = motion.draw_latents(np.zeros((6, 4000)), RNG)
    assert latents.shape == (motion.latent_size, 4000)
    assert (latents[[LANE, NEXT]] == NOWHERE).all()
    assert np.hypot(np.cos(latents[HEADING]).mean(), np.sin(latents[HEADING]).mean()) < 0.05


def test_lanes_guide_where_there_are_any() -> None:
    inner = Memoryless("stand", lambda state, *_: state)
    assert isinstance(in_plane(inner, graph_of({"bend": arc(60.0, 1.0, 10)})), LaneFollowing)
    assert isinstance(in_plane(inner, without_map()), OffMapMotion)


def test_a_plane_without_a_map_has_no_lane_beside_any_place_that_is_driven() -> None:
    near = without_map().lanes_near(np.array([0.0, 1e5]), np.array([0.0, -1e5]))
    assert (near.lane == NOWHERE).all()


def measured(heading_rad: float, count: int = 1) -> BodyHeadings:
    return BodyHeadings(np.full(count, heading_rad), np.full(count, 0.1), np.full(count, 0.2))


def test_particles_are_born_around_the_measured_direction_and_some_turned_round() -> None:
    motion = drifting(0.0)
    latents = motion.towards(motion.draw_latents(np.zeros((6, 20_000)), RNG), measured(3.0), RNG)
    off = np.abs(wrapped(latents[HEADING] - 3.0))
    assert (off < 0.3).mean() == pytest.approx(0.95 * 0.8, abs=0.02)
    assert (off > np.pi - 0.3).mean() == pytest.approx(0.95 * 0.2, abs=0.02)


def test_the_likelihood_of_a_direction_is_a_density_over_the_circle() -> None:
    direction = np.linspace(-np.pi, np.pi, 20_001)[:-1]
    for heading in (0.0, 3.1):
        # Against a direction that may be any: the mean over all directions of particles is one.
        assert heading_ratio(direction, measured(heading, len(direction))).mean() == pytest.approx(1.0, abs=1e-3)
    ahead, back, across = heading_ratio(np.array([0.0, np.pi, 0.5 * np.pi]), measured(0.0, 3))
    assert ahead / back == pytest.approx(4.0, rel=0.05)
    assert across == pytest.approx(0.05)
