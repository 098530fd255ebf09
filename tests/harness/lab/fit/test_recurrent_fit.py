"""Fitting a network with a memory: JAX's rollouts against those in use, and the message where there is no JAX."""

from importlib.util import find_spec

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.lab.fit import recurrent_fit
from harness.lab.fit.recurrent_fit import fit_recurrent
from harness.lab.fit.unrolled import crps_and_slope
from mmpf.motion.learned.driver import with_follower
from mmpf.motion.learned.recurrent import NOISE, RecurrentFollower
from mmpf.motion.learned.residual import TIME_SCALES_S
from mmpf.motion.protocol import Neighbour
from mmpf.motion.state import ACCEL, LON, SPEED
from tests.harness.lab.fit.test_unrolled import assert_learned, windows

HAS_JAX = find_spec("jax") is not None


@pytest.mark.skipif(HAS_JAX, reason="JAX is installed")
def test_without_jax_the_fit_says_what_to_install():
    with pytest.raises(InputError, match=r"pip install -c constraints.txt '\.\[deep\]'"):
        fit_recurrent(windows(20, np.random.default_rng(0)), 0, lambda line: None, iterations=1)


@pytest.mark.skipif(not HAS_JAX, reason="needs the extra deep")
def test_the_score_in_the_fit_is_that_of_the_model_in_use():
    rng, count, p = np.random.default_rng(0), 12, recurrent_fit.PARTICLES
    some = windows(count, rng, gap_m=40.0, pull=0.3)
    parts = [part[:5] for part in recurrent_fit.scaling_of(some)[:4]]
    weights = recurrent_fit.initial_weights(rng, 8)
    inputs = recurrent_fit.drawn_inputs(some, np.arange(count), rng)
    inputs["led"] = np.arange(count * p) >= 2 * p
    found, _ = recurrent_fit.compiled_score(*parts)(weights, inputs)

    follower = RecurrentFollower(recurrent_fit.network_of(parts, weights))
    n, expected = count * p, 0.0
    state, drivers = np.zeros((6, n)), np.zeros((follower.latent_size, n))
    drivers[:NOISE] = inputs["noise"][0]
    lasts = np.exp(-0.1 / np.array(TIME_SCALES_S))[:, None]
    for step in range(len(inputs["leader"]) - 1):
        seen = step <= inputs["alone_from"]
        state[[LON, SPEED, ACCEL]] = np.where(seen, inputs["recorded"][step], state[[LON, SPEED, ACCEL]])
        ahead, speed, accel = inputs["leader"][step].astype(float)
        leader = Neighbour(inputs["led"], ahead - state[LON], speed, accel, np.full(n, 5.0))
        noise = lasts * drivers[:NOISE] + np.sqrt(1.0 - lasts**2) * inputs["noise"][step + 1]
        state[ACCEL] = follower.accelerations(state, drivers, leader, np.arange(n), 0.1, rng)
        drivers[:NOISE] = noise
        before, state[SPEED] = state[SPEED].copy(), np.maximum(state[SPEED] + 0.1 * state[ACCEL], 0.0)
        state[LON] += 0.05 * (before + state[SPEED])
        for row, true, weight in ((LON, "true_m", "weight_m"), (SPEED, "true_speed_mps", "weight_mps")):
            for k in range(count):
                crps, _ = crps_and_slope(state[row, None, k * p : k * p + p], inputs[true][step + 1, None, k, None])
                expected += inputs[weight][step + 1, k] * crps[0, 0]
    assert float(found) == pytest.approx(expected, rel=1e-3)


@pytest.mark.skipif(not HAS_JAX, reason="needs the extra deep")
def test_the_fit_learns_what_drivers_do_and_how_they_differ():
    rng = np.random.default_rng(2)
    network = fit_recurrent(windows(200, rng, gap_m=40.0, pull=0.3), 0, lambda line: None, iterations=80)
    assert_learned(with_follower(RecurrentFollower(network), "recurrent"), rng)
