"""The follower of IDM and a network, against a plain computation, and its file against damage."""

import numpy as np
import pytest

from mmpf.motion.idm import idm_acceleration
from mmpf.motion.learned.driver import residual_driver
from mmpf.motion.learned.residual import IDM_RANGE_MPS2, TIME_SCALES_S, USUAL_DRIVER, ResidualFollower
from mmpf.motion.state import ACCEL, SPEED
from tests.mmpf.motion.surroundings import states, vehicle

DT_S = 0.1


@pytest.fixture
def follower():
    return residual_driver().model.follower


def test_accelerations_are_those_of_a_plain_network(follower):
    rng, n = np.random.default_rng(0), 150
    state, leader = states(n, 15.0), vehicle(n, 25.0, 13.0, accel_mps2=0.4)
    state[ACCEL] = rng.standard_normal(n)
    drivers = follower.draw(state, leader, np.arange(n), rng)
    network = follower.network
    headway = drivers[0]
    seen = np.stack([np.full(n, np.log(25.0)), state[SPEED], state[ACCEL], np.full(n, 2.0), np.full(n, 0.4), headway])
    inputs = (np.clip(seen.T, network.low, network.high) - network.mean) / network.scale
    units = np.hstack([inputs, drivers[1:].T])
    for weights, shift in ((network.w1, network.b1), (network.w2, network.b2)):
        units = units @ weights + shift
        units = units / (1.0 + np.abs(units))
    wanted = np.clip(idm_acceleration(state[SPEED], leader, USUAL_DRIVER), *IDM_RANGE_MPS2)
    wanted = wanted + units @ network.w3 + network.b3
    found = follower.accelerations(state, drivers.copy(), leader, np.arange(n), DT_S, rng)
    np.testing.assert_allclose(found, state[ACCEL] + network.lag * (wanted - state[ACCEL]), atol=2e-4)


def test_noise_keeps_its_spread_and_lasts_as_long_as_it_should(follower):
    rng, n = np.random.default_rng(1), 4000
    state, leader = states(n, 15.0), vehicle(n, 25.0, 13.0)
    before = follower.draw(state, leader, np.arange(n), rng)
    after = before.copy()
    for _ in range(20):
        follower.accelerations(state, after, leader, np.arange(n), DT_S, rng)
    for row, scale_s in enumerate(TIME_SCALES_S, start=1):
        assert after[row].std() == pytest.approx(1.0, abs=0.05)
        assert np.corrcoef(before[row], after[row])[0, 1] == pytest.approx(np.exp(-2.0 / scale_s), abs=0.05)


def test_a_driver_without_a_leader_has_the_usual_headway(follower):
    state, leader = states(3, 15.0), vehicle(3, 500.0, 15.0)
    drivers = ResidualFollower(follower.network).draw(state, leader, np.arange(3), np.random.default_rng(0))
    np.testing.assert_allclose(drivers[0], follower.network.mean[-1])
