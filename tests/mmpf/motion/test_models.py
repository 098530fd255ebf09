"""What every motion model must do, and what each is for."""

import numpy as np
import pytest

from mmpf.motion.idm import TREIBER_2000, idm_acceleration, intelligent_driver
from mmpf.motion.kinematic import ProcessNoise, constant_acceleration, kinematic
from mmpf.motion.protocol import Memoryless, motion_models, spreads_speed
from mmpf.motion.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED
from tests.mmpf.motion.surroundings import around, nobody, states, vehicle

QUIET = ProcessNoise(0.0, 0.0)
STEP_S = 0.1
HARD_PLACES = {
    "free road": around,
    "off the road": lambda state: around(state, on_road=False),
    "far leader": lambda state: around(state, vehicle(state.shape[1], 99.0, 30.0)),
    "hidden leader": lambda state: around(state, vehicle(state.shape[1], 20.0, 15.0), hidden=True),
    "truck ahead": lambda state: around(state, vehicle(state.shape[1], 10.0, 10.0, length_m=20.0)),
    "standing leader at the bumper": lambda state: around(state, vehicle(state.shape[1], 0.0, 0.0)),
    "overlap": lambda state: around(state, vehicle(state.shape[1], -6.0, 5.0)),
    "braking leader": lambda state: around(state, vehicle(state.shape[1], 15.0, 3.0, accel_mps2=-8.0)),
    "absurd leader": lambda state: around(state, vehicle(state.shape[1], 1e6, 500.0, accel_mps2=40.0)),
}


@pytest.mark.parametrize("place", HARD_PLACES)
@pytest.mark.parametrize("name", list(motion_models))
def test_no_model_reverses_jumps_or_loses_its_numbers(name, place):
    model, rng = motion_models[name](), np.random.default_rng(0)
    state = states(200, 0.0)
    state[SPEED] = np.repeat([0.0, 0.4, 25.0, 60.0], 50)
    state[ACCEL] = rng.normal(0.0, 3.0, 200)
    latents = model.draw_latents(state, rng)
    assert latents.shape == (model.latent_size, 200)
    for _ in range(30):
        before = state.copy()
        after, latents = model.propagate(state, latents, HARD_PLACES[place](state), STEP_S, rng)
        assert np.isfinite(after).all()
        assert np.isfinite(latents).all()
        assert latents.shape == (model.latent_size, 200)
        assert (after[SPEED] >= 0.0).all()
        np.testing.assert_array_equal(state, before)
        furthest = STEP_S * np.maximum(before[SPEED], after[SPEED]) + 0.5
        assert (after[LON] - before[LON] >= -1e-9).all()
        assert (after[LON] - before[LON] <= furthest).all()
        assert (np.abs(after[LAT] - before[LAT]) < 3.0).all()
        state = after


@pytest.mark.parametrize("name", list(motion_models))
def test_no_particles_are_no_trouble(name):
    model, rng = motion_models[name](), np.random.default_rng(0)
    state = states(0)
    after, latents = model.propagate(state, model.draw_latents(state, rng), around(state), STEP_S, rng)
    assert after.shape == (6, 0)
    assert latents.shape == (model.latent_size, 0)


@pytest.mark.parametrize("name", list(motion_models))
def test_the_same_seed_gives_the_same_step(name):
    model, state = motion_models[name](), states(20)

    def step():
        rng = np.random.default_rng(5)
        return model.propagate(
            state, model.draw_latents(state, rng), around(state, vehicle(20, 15.0, 18.0)), STEP_S, rng
        )

    first, second = step(), step()
    np.testing.assert_array_equal(first[0], second[0])
    np.testing.assert_array_equal(first[1], second[1])


def run(model, state, steps, look=around):
    rng = np.random.default_rng(1)
    latents = model.draw_latents(state, rng)
    for _ in range(steps):
        state, latents = model.propagate(state, latents, look(state), STEP_S, rng)
    return state


def test_constant_velocity_without_noise_moves_in_a_straight_line():
    state = states(1, speed_mps=20.0)
    state[LAT_SPEED] = 0.5
    after = run(kinematic("cvm", QUIET), state, 100)
    assert after[LON, 0] == pytest.approx(200.0)
    assert after[LAT, 0] == pytest.approx(2.0 + 5.0)


def test_constant_velocity_noise_spreads_the_speed_with_the_root_of_time():
    after = run(kinematic("cvm", ProcessNoise(0.5, 0.1)), states(20_000), 100)
    assert after[SPEED].std() == pytest.approx(0.5 * np.sqrt(10.0), rel=0.03)
    assert after[LON].std() == pytest.approx(0.5 * np.sqrt(10.0**3 / 3.0), rel=0.03)


def test_constant_acceleration_without_noise_follows_the_parabola():
    state = states(1, speed_mps=10.0)
    state[ACCEL] = 1.5
    after = run(kinematic("cam", QUIET), state, 100)
    assert after[LON, 0] == pytest.approx(10.0 * 10.0 + 0.5 * 1.5 * 10.0**2)
    assert after[SPEED, 0] == pytest.approx(25.0)


def test_under_constant_acceleration_a_lateral_kick_acts_over_the_whole_step():
    state, kick = states(1, speed_mps=10.0), np.array([2.0])
    state[LAT_SPEED], state[LAT_ACCEL] = 0.5, 1.0
    after = constant_acceleration(state, np.zeros(1), kick, STEP_S)
    # The acceleration goes from 1 to 3 m/s²: by the trapezoid rule it is 2 on average.
    assert after[LAT_ACCEL, 0] == pytest.approx(3.0)
    assert after[LAT_SPEED, 0] == pytest.approx(0.5 + STEP_S * 2.0)
    assert after[LAT, 0] == pytest.approx(2.0 + STEP_S * (0.5 + 0.5 * STEP_S * 2.0))


def test_a_braking_car_stops_and_stays():
    state = states(1, speed_mps=5.0)
    state[ACCEL] = -2.0
    after = run(kinematic("cam", QUIET), state, 100)
    assert after[SPEED, 0] == 0.0
    assert after[LON, 0] == pytest.approx(5.0**2 / (2.0 * 2.0), abs=0.6)


def test_a_bicycle_of_constant_steering_drives_a_circle():
    state = states(1, speed_mps=10.0)
    radius = 400.0
    state[LAT_ACCEL] = 10.0**2 / radius
    after = run(kinematic("csav", QUIET), state, 100)
    assert after[LON, 0] == pytest.approx(radius * np.sin(100.0 / radius), abs=1e-2)
    assert after[LAT, 0] - 2.0 == pytest.approx(radius * (1.0 - np.cos(100.0 / radius)), abs=1e-2)
    assert np.hypot(after[SPEED, 0], after[LAT_SPEED, 0]) == pytest.approx(10.0)


def test_a_bicycle_that_speeds_up_keeps_its_curvature():
    state = states(1, speed_mps=10.0)
    state[LAT_ACCEL], state[ACCEL] = 0.25, 1.0
    after = run(kinematic("csaa", QUIET), state, 50)
    speed_squared = after[SPEED, 0] ** 2 + after[LAT_SPEED, 0] ** 2
    assert after[LAT_ACCEL, 0] / speed_squared == pytest.approx(0.25 / 100.0, rel=1e-3)


def test_idm_settles_at_its_equilibrium_gap():
    speed = 15.0
    state = states(1, speed_mps=speed)
    leader_lon = [30.0]

    def look(now):
        leader_lon[0] += speed * STEP_S
        return around(now, vehicle(1, leader_lon[0] - now[LON, 0], speed))

    after = run(intelligent_driver(noise=QUIET), state, 3000, look)
    gap = leader_lon[0] + speed * STEP_S - after[LON, 0]
    wanted = TREIBER_2000.standstill_gap_m + speed * TREIBER_2000.time_headway_s
    equilibrium = wanted / np.sqrt(1.0 - (speed / TREIBER_2000.desired_speed_mps) ** 4)
    assert gap == pytest.approx(equilibrium, rel=0.01)
    assert after[SPEED, 0] == pytest.approx(speed, abs=0.01)


def test_idm_on_a_free_road_accelerates_by_the_published_formula():
    speed = np.array([0.0, 20.0, TREIBER_2000.desired_speed_mps])
    free = idm_acceleration(speed, nobody(states(3)), TREIBER_2000)
    expected = 0.73 * (1.0 - (speed / (120.0 / 3.6)) ** 4)
    np.testing.assert_allclose(free, expected, atol=1e-12)


def test_a_function_alone_makes_a_model():
    model = Memoryless("parked", lambda state, surroundings, dt_s, rng: np.zeros_like(state), spreads_speed=True)
    state, rng = states(3), np.random.default_rng(0)
    after, latents = model.propagate(state, model.draw_latents(state, rng), around(state), STEP_S, rng)
    assert not after.any()
    assert latents.shape == (model.latent_size, 3) == (0, 3)
    assert spreads_speed(model)
