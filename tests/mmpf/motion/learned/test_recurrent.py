"""The follower with a memory, against a plain computation, and its file against damage."""

from dataclasses import replace

import numpy as np
import pytest

from mmpf.motion.idm import idm_acceleration
from mmpf.motion.learned.driver import FOLLOWER, recurrent_driver
from mmpf.motion.learned.recurrent import NOISE
from mmpf.motion.learned.residual import IDM_RANGE_MPS2, USUAL_DRIVER
from mmpf.motion.state import ACCEL, SPEED
from tests.mmpf.motion.surroundings import around, states, vehicle

DT_S = 0.1


@pytest.fixture
def follower():
    return recurrent_driver().model.follower


def sigmoid_like(x):
    return 0.5 * (1.0 + x / (1.0 + abs(x)))


def plain_step(network, seen, noise, memory):
    """Return what is added to IDM and the next memory, one particle at a time, as Cho et al. write it."""
    units = len(network.c)
    x = (np.clip(seen, network.low, network.high) - network.mean) / network.scale
    w, u, b = (np.split(np.asarray(part, dtype=float), 3, axis=-1) for part in (network.w, network.u, network.b))
    update = sigmoid_like(x @ w[0] + memory @ u[0] + b[0])
    reset = sigmoid_like(x @ w[1] + memory @ u[1] + b[1])
    new = x @ w[2] + b[2] + reset * (memory @ u[2] + network.c)
    memory = (1.0 - update) * memory + update * new / (1.0 + abs(new))
    assert memory.shape == (units,)
    said = memory @ network.out + network.shift
    factors = [1.0 + f if f > 0.0 else 1.0 / (1.0 - f) for f in said[1:]]
    return said[0] + np.dot(factors, noise), memory


def test_accelerations_and_memories_are_those_of_a_plain_network(follower):
    rng, n = np.random.default_rng(0), 40
    state, leader, network = states(n, 15.0), vehicle(n, 25.0, 13.0, accel_mps2=0.4), follower.network
    state[ACCEL] = rng.standard_normal(n)
    drivers = np.zeros((follower.latent_size, n))
    drivers[:NOISE] = follower.draw(state, leader, np.arange(n), rng)
    drivers[NOISE:] = rng.uniform(-1.0, 1.0, (follower.latent_size - NOISE, n))
    after = drivers.copy()
    found = follower.accelerations(state, after, leader, np.arange(n), DT_S, rng)
    usual = np.clip(idm_acceleration(state[SPEED], leader, USUAL_DRIVER), *IDM_RANGE_MPS2)
    for k in range(n):
        seen = np.array([np.log(25.0), state[SPEED, k], state[ACCEL, k], 2.0, 0.4])
        added, memory = plain_step(network, seen, drivers[:NOISE, k], drivers[NOISE:, k])
        wanted = usual[k] + added
        assert found[k] == pytest.approx(state[ACCEL, k] + network.lag[0] * (wanted - state[ACCEL, k]), abs=2e-4)
        np.testing.assert_allclose(after[NOISE:, k], memory, atol=1e-5)


def test_one_of_many_particles_alone_is_moved_the_same_way(follower):
    rng, n = np.random.default_rng(1), 300
    state, leader = states(n, 15.0), vehicle(n, 25.0, 13.0)
    drivers = rng.uniform(-1.0, 1.0, (follower.latent_size, n))
    everyone, some = drivers.copy(), drivers.copy()
    all_of_them = follower.accelerations(state, everyone, leader, np.arange(n), DT_S, rng)
    chosen = np.array([3, 4, 250])
    np.testing.assert_allclose(follower.accelerations(state, some, leader, chosen, DT_S, rng), all_of_them[chosen])
    np.testing.assert_allclose(some[NOISE:, chosen], everyone[NOISE:, chosen])
    np.testing.assert_array_equal(np.delete(some[NOISE:], chosen, axis=1), np.delete(drivers[NOISE:], chosen, axis=1))


def test_two_steps_in_one_change_the_memory_nearly_as_much_as_two(follower):
    rng, n = np.random.default_rng(2), 200
    state, leader = states(n, 15.0), vehicle(n, 25.0, 13.0)
    start = np.zeros((follower.latent_size, n))
    once, twice = start.copy(), start.copy()
    follower.accelerations(state, once, leader, np.arange(n), 2 * DT_S, rng)
    for _ in range(2):
        follower.accelerations(state, twice, leader, np.arange(n), DT_S, rng)
    np.testing.assert_allclose(once[NOISE:], twice[NOISE:], atol=0.15)


def test_a_driver_drawn_anew_keeps_the_memory_of_what_was_seen():
    model, rng, n = replace(recurrent_driver(), changes_lanes=False), np.random.default_rng(3), 2000
    state = states(n, 15.0)
    seen = around(state)
    _, latents = model.propagate(state, model.draw_latents(state, rng), seen, DT_S, rng)
    memory = latents[FOLLOWER + NOISE :]
    assert (memory != 0.0).any(axis=0).all()
    drawn = latents.copy()
    model._draw_drivers(state, drawn, seen, 2.0, rng)
    anew = (drawn[FOLLOWER : FOLLOWER + NOISE] != latents[FOLLOWER : FOLLOWER + NOISE]).any(axis=0)
    assert anew.any()
    np.testing.assert_array_equal(drawn[FOLLOWER + NOISE :], memory)
