"""Doubts of what is ahead: how they are spread, how long they last, and what a filter learns by them."""

import numpy as np
import pytest

from mmpf.motion.doubting import DOUBT, REDRAWN_PER_S, Doubting
from mmpf.motion.manoeuvring import Manoeuvring
from mmpf.motion.protocol import motion_models, spreads_speed
from mmpf.motion.standing import Standing
from mmpf.motion.tries import log_prior_over_tried
from tests.mmpf.motion.surroundings import around, states

DT_S = 0.1


@pytest.mark.parametrize("outer", [Doubting, Standing])
@pytest.mark.parametrize("inner", ["cvm", "idm", "gmm"])
def test_hidden_vehicles_that_move_do_what_the_inner_model_says_and_keep_their_doubts(inner: str, outer: type) -> None:
    state, alone = states(200), motion_models[inner]()
    model, hidden = outer(alone), around(state, hidden=True)
    latents = model.draw_latents(state, np.random.default_rng(1))
    moved, carried = model.propagate(state, latents, hidden, DT_S, np.random.default_rng(2))
    expected, kept = alone.propagate(state, latents[: alone.latent_size], hidden, DT_S, np.random.default_rng(2))
    np.testing.assert_array_equal(moved, expected)
    np.testing.assert_array_equal(carried, np.vstack([kept, latents[alone.latent_size :]]))
    assert spreads_speed(model) == spreads_speed(alone)


def test_doubts_in_sight_stay_evenly_spread_and_are_forgotten_at_the_stated_rate() -> None:
    state, rng = states(20_000), np.random.default_rng(0)
    model = Doubting(motion_models["cvm"]())
    first = latents = model.draw_latents(state, rng)
    for _ in range(30):
        _, latents = model.propagate(state, latents, around(state), DT_S, rng)
    for doubt in (first[DOUBT], latents[DOUBT]):
        np.testing.assert_allclose(np.quantile(doubt, [0.1, 0.5, 0.9]), [0.1, 0.5, 0.9], atol=0.015)
    assert (latents[DOUBT] == first[DOUBT]).mean() == pytest.approx(np.exp(-REDRAWN_PER_S * 3.0), abs=0.015)


def test_the_weights_of_what_the_inner_model_tries_stay_as_they_were() -> None:
    state, rng = states(500), np.random.default_rng(3)
    inner = Manoeuvring(motion_models["cvm"](), 0.5, 0.05, 2.0, accel_std_mps2=3.0)
    model, seen = Doubting(inner), around(state)
    before = model.draw_latents(state, rng)
    _, after = model.propagate(state, before, seen, DT_S, rng)
    expected = inner.log_prior_over_tried(before[:DOUBT], after[:DOUBT], seen, DT_S)
    np.testing.assert_array_equal(log_prior_over_tried(model, before, after, seen, DT_S), expected)
    assert (expected != 0.0).any()
