"""What the learned driver sees: by definition, and alike in training and in use."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mmpf.motion.learned.driver import HABIT, LearnedDriver
from mmpf.motion.learned.features import log_headway, situation
from mmpf.motion.protocol import Neighbour
from mmpf.motion.state import ACCEL, SPEED
from tests.mmpf.motion.surroundings import around, states

FOLLOWERS = 7


def columns(low: float, high: float) -> st.SearchStrategy[np.ndarray]:
    return arrays.arrays(np.float64, FOLLOWERS, elements=st.floats(low, high))


@dataclass
class ListeningMixture:
    """Stands for the fitted mixture and keeps what it was asked."""

    asked: list[np.ndarray] = field(default_factory=list)

    def sample_columns(self, x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        self.asked.append(x.copy())
        return np.zeros((1, x.shape[1]))


def test_a_situation_is_log_gap_speed_acceleration_closing_speed_and_the_leaders_acceleration():
    seen = situation(
        np.array([20.0, -1.0]), np.array([15.0, 3.0]), np.array([0.5, -2.0]), np.array([12.0, 4.0]), np.array([-1.0, 0])
    )
    assert seen == pytest.approx(
        np.array([[math.log(20.0), 15.0, 0.5, 3.0, -1.0], [math.log(0.3), 3.0, -2.0, -1.0, 0.0]])
    )
    assert seen.flags.c_contiguous


def listening_driver():
    driver, listening = LearnedDriver(changes_lanes=False), ListeningMixture()
    follower = replace(driver.model.follower, following=listening)
    return replace(driver, model=replace(driver.model, follower=follower)), listening


@given(columns(-5.0, 99.0), columns(0.0, 40.0), columns(-8.0, 4.0), columns(0.0, 40.0), columns(-8.0, 4.0))
@settings(max_examples=50, deadline=None)
def test_in_use_the_mixture_is_asked_what_it_was_taught(gap, speed, accel, leader_speed, leader_accel):
    driver, listening = listening_driver()
    state = states(FOLLOWERS)
    state[SPEED], state[ACCEL] = speed, accel
    leader = Neighbour(np.ones(FOLLOWERS, dtype=bool), gap, leader_speed, leader_accel, np.full(FOLLOWERS, 4.6))
    latents = driver.draw_latents(state, np.random.default_rng(0))
    _, latents = driver.propagate(state, latents, around(state, leader), 0.1, np.random.default_rng(0))

    taught = np.column_stack([situation(gap, speed, accel, leader_speed, leader_accel), latents[HABIT]])
    np.testing.assert_allclose(listening.asked[0].T, taught, rtol=2e-6, atol=2e-6)


def test_only_those_who_follow_are_asked_for_and_in_their_order():
    driver, listening = listening_driver()
    state = states(3)
    state[SPEED] = [10.0, 11.0, 12.0]
    leader = Neighbour(
        np.array([True, False, True]), np.array([30.0, np.inf, 40.0]), state[SPEED], np.zeros(3), np.full(3, 4.6)
    )
    latents = driver.draw_latents(state, np.random.default_rng(0))
    driver.propagate(state, latents, around(state, leader), 0.1, np.random.default_rng(0))
    assert listening.asked[0][1].tolist() == [10.0, 12.0]
    assert listening.asked[0][0] == pytest.approx(np.log([30.0, 40.0]), rel=1e-6)


@given(st.floats(-5.0, 200.0), st.floats(0.0, 50.0))
def test_the_headway_counts_from_the_standstill_gap_and_from_three_metres_a_second_on(gap, speed):
    expected = math.log(max(gap - 2.0, 0.3) / max(speed, 3.0))
    assert log_headway(np.array([gap]), np.array([speed]))[0] == pytest.approx(expected)
