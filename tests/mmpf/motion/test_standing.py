"""Vehicles that stand: how long they stay, and where."""

import numpy as np
import pytest

from mmpf.motion.protocol import Memoryless
from mmpf.motion.standing import DRIFT_STD, STANDS_MPS, STARTS_PER_S, Standing
from mmpf.motion.state import LON, SPEED
from tests.mmpf.motion.surroundings import around, states


def pulling_away(state, surroundings, dt_s, rng):
    after = state.copy()
    after[SPEED] += 1.0 * dt_s
    after[LON] += state[SPEED] * dt_s
    return after


def test_standing_vehicles_start_at_the_stated_rate_and_the_others_stay_in_place() -> None:
    model, state, rng = (
        Standing(Memoryless("pulling away", pulling_away)),
        states(20_000, 0.0),
        np.random.default_rng(0),
    )
    latents = model.draw_latents(state, rng)
    for _ in range(20):
        state, latents = model.propagate(state, latents, around(state), 0.1, rng)
    stands = state[SPEED] == 0.0
    assert stands.mean() == pytest.approx(np.exp(-STARTS_PER_S * 2.0), abs=0.015)
    assert (state[SPEED, ~stands] >= STANDS_MPS).all()
    assert state[LON, stands].mean() == pytest.approx(0.0, abs=0.005)
    assert state[LON, stands].std() == pytest.approx(DRIFT_STD * np.sqrt(2.0), rel=0.05)
