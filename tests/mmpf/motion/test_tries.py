"""What particles try more often than vehicles do weighs the less, so that nothing is gained or lost on the whole."""

from typing import cast

import numpy as np
import pytest

from mmpf.motion.learned.driver import INTENTION, TARGET, LearnedDriver
from mmpf.motion.manoeuvring import HOLDS, Manoeuvring
from mmpf.motion.protocol import MotionModel, motion_models
from mmpf.motion.tries import log_prior_over_tried, log_ratio_of_begun
from mmpf.numerics.arrays import FloatArray
from tests.mmpf.motion.surroundings import around, states

DT_S, TRIED_PER_S, TRUE_PER_S = 0.1, 1.0, 0.1
COUNT = 40_000


def manoeuvring(inner: str, tried_per_s: float = TRIED_PER_S, true_per_s: float = TRUE_PER_S) -> Manoeuvring:
    return Manoeuvring(motion_models[inner](), tried_per_s, true_per_s, mean_s=2.0, accel_std_mps2=3.0)


def driven(model: MotionModel, steps: int, *, hidden: bool = False) -> tuple[FloatArray, FloatArray]:
    """Latents after some steps without a detection, and weights."""
    state, rng = states(COUNT), np.random.default_rng(0)
    latents, log_weight = model.draw_latents(state, rng), np.zeros(COUNT)
    for _ in range(steps):
        surroundings = around(state, hidden=hidden)
        state, after = model.propagate(state, latents, surroundings, DT_S, rng)
        log_weight += log_prior_over_tried(model, latents, after, surroundings, DT_S)
        latents = after
    return latents, np.exp(log_weight)


def test_where_nothing_is_detected_as_much_weight_is_in_manoeuvres_as_drivers_are() -> None:
    latents, weight = driven(manoeuvring("cvm"), 10)
    holds = latents[HOLDS] != 0.0
    chain, share = np.array([1.0 - np.exp(-DT_S * TRUE_PER_S), np.exp(-DT_S / 2.0)]), 0.0
    for _ in range(10):
        share = (1.0 - share) * chain[0] + share * chain[1]
    assert holds.mean() > 5.0 * share
    assert weight.mean() == pytest.approx(1.0, abs=0.02)
    assert weight[holds].sum() / weight.sum() == pytest.approx(share, rel=0.05)


@pytest.mark.parametrize("name", ["gmm", "residual"])
def test_as_much_weight_is_in_lane_changes_as_drivers_change(name: str) -> None:
    model = cast("LearnedDriver", motion_models[name]())
    latents, weight = driven(model, 5)
    changes, rate = latents[INTENTION] != 0.0, model.model.keeper.changes_per_s
    assert changes.mean() > 5.0 * 2.0 * rate * 5 * DT_S
    assert weight.mean() == pytest.approx(1.0, abs=0.02)
    assert weight[changes].sum() / weight.sum() == pytest.approx(1.0 - (1.0 - 2.0 * rate * DT_S) ** 5, rel=0.15)


@pytest.mark.parametrize("inner", ["cvm", "gmm"])
def test_who_is_hidden_tries_nothing_and_keeps_its_weight(inner: str) -> None:
    _, weight = driven(manoeuvring(inner), 5, hidden=True)
    assert (weight == 1.0).all()


def test_a_model_that_draws_from_its_prior_weighs_nothing() -> None:
    _, weight = driven(motion_models["cvm"](), 2)
    assert (weight == 1.0).all()


def test_who_goes_on_with_what_it_began_keeps_its_weight() -> None:
    state = states(3)
    # The rows of habits and noise change at every step, whatever the intention.
    before, after = np.zeros((8, 3)), np.random.default_rng(0).normal(size=(8, 3))
    before[INTENTION], before[TARGET] = 1.0, 9.0
    after[INTENTION], after[TARGET] = [1.0, -1.0, 0.0], [9.0, 2.0, 9.0]
    keeper = LearnedDriver().model.keeper
    went_on, began_another, ended = LearnedDriver().log_prior_over_tried(before, after, around(state), DT_S)
    assert went_on == 0.0
    assert began_another == pytest.approx(np.log(keeper.changes_per_s / keeper.seen_changes_per_s))
    not_begun = (1.0 - 2.0 * DT_S * keeper.changes_per_s) / (1.0 - 2.0 * DT_S * keeper.seen_changes_per_s)
    assert ended == pytest.approx(np.log(not_begun))


@pytest.mark.parametrize("ways", [0, 1, 2])
def test_the_mean_of_the_ratio_is_one_over_what_a_particle_may_do(ways: int) -> None:
    true, tried = 0.02, 0.3
    begun = np.array([True, False])
    ratio = np.exp(log_ratio_of_begun(begun, np.ones(2, dtype=np.bool_), true, tried, ways))
    assert ways * tried * ratio[0] + (1.0 - ways * tried) * ratio[1] == pytest.approx(1.0)
