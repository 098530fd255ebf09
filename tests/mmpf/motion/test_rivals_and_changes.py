"""The adaptive IDM takes up each driver's headway; the lane-change model crosses to either side alike."""

from dataclasses import replace

import numpy as np
import pytest

from mmpf.motion.idm import TREIBER_2000, Adaptation, AdaptiveDriver, idm_acceleration
from mmpf.motion.kinematic import ProcessNoise
from mmpf.motion.learned.lane_changer import LaneChangeDriver
from mmpf.motion.learned.short_driver import short_term_driver
from mmpf.motion.learned.short_pair import ShortTermPair
from mmpf.motion.protocol import take_surroundings
from mmpf.motion.state import ACCEL, LAT, LAT_SPEED, SPEED
from tests.mmpf.motion.surroundings import around, in_lanes, states, vehicle

STEP_S = 0.1


@pytest.mark.parametrize("headway", [0.8, 1.6, 2.8])
def test_the_first_acceleration_tells_the_headway(headway):
    state, leader = states(1, 15.0), vehicle(1, 35.0, 14.0)
    state[ACCEL] = idm_acceleration(state[SPEED], leader, TREIBER_2000, np.array([headway]))
    model = AdaptiveDriver(TREIBER_2000, Adaptation(2.0, 0.0, 1.0), ProcessNoise(0.0, 0.0))
    after, latents = model.propagate(
        state,
        model.draw_latents(state, np.random.default_rng(0)),
        around(state, leader),
        STEP_S,
        np.random.default_rng(0),
    )
    assert latents[0, 0] == pytest.approx(headway)
    assert after[ACCEL, 0] == pytest.approx(state[ACCEL, 0])


@pytest.mark.parametrize("dt_s", [0.05, 0.1, 0.2, 1.0])
def test_the_acceleration_approaches_idms_at_the_drivers_rate_whatever_the_step(dt_s):
    state, leader, rng = states(1, 15.0), vehicle(1, 35.0, 14.0), np.random.default_rng(0)
    state[ACCEL] = -1.0
    model = AdaptiveDriver(TREIBER_2000, Adaptation(2.0, 0.0, 0.0), ProcessNoise(0.0, 0.0))
    wanted = idm_acceleration(state[SPEED], leader, TREIBER_2000)
    after, _ = model.propagate(state, model.draw_latents(state, rng), around(state, leader), dt_s, rng)
    assert after[ACCEL] == pytest.approx(-1.0 + min(2.0 * dt_s, 1.0) * (wanted + 1.0))


def test_deviations_of_the_adaptive_driver_keep_their_spread_and_fade_at_their_rate():
    n, rng = 4000, np.random.default_rng(0)
    state, leader = states(n, 15.0), vehicle(n, 35.0, 14.0)
    model = AdaptiveDriver(TREIBER_2000, Adaptation(2.0, 0.0, 0.0, 0.5, 3.0), ProcessNoise(0.0, 0.0))
    before = latents = model.draw_latents(state, rng)
    for _ in range(20):
        _, latents = model.propagate(state, latents, around(state, leader), STEP_S, rng)
    assert latents[1].std() == pytest.approx(0.5, rel=0.05)
    assert np.corrcoef(before[1], latents[1])[0, 1] == pytest.approx(np.exp(-2.0 / 3.0), abs=0.05)


def test_a_lane_change_to_the_left_is_the_mirror_of_one_to_the_right():
    def driven(to_left):
        model, state = LaneChangeDriver(to_left=to_left), states(50, 20.0)
        state[LAT_SPEED] = 0.6 if to_left else -0.6
        rng = np.random.default_rng(3)
        after, _ = model.propagate(state, model.draw_latents(state, rng), around(state), STEP_S, rng)
        return after

    left, right = driven(True), driven(False)
    np.testing.assert_allclose(left[LAT] - 2.0, 2.0 - right[LAT], atol=1e-9)
    np.testing.assert_allclose(left[SPEED], right[SPEED], atol=1e-9)


def test_a_car_under_way_to_the_next_lane_arrives_there():
    model, state, rng = LaneChangeDriver(), states(3000, 20.0, lat_m=3.4), np.random.default_rng(0)
    state[LAT_SPEED] = 0.9
    latents = model.draw_latents(state, rng)
    for _ in range(40):
        state, latents = model.propagate(state, latents, in_lanes(state, 0, 1), STEP_S, rng)
    assert np.median(state[LAT]) > 4.5
    assert (state[LAT] > 4.0).mean() > 0.85


def test_the_pair_of_short_term_models_keeps_the_lane_as_the_first_does():
    keeper, state = replace(ShortTermPair().rates, changes_per_s=0.0, seen_changes_per_s=0.0), states(200, 20.0)
    model, rngs = ShortTermPair(rates=keeper), [np.random.default_rng(3), np.random.default_rng(3)]
    rngs[1].random(200, dtype=np.float32)  # what the intentions draw
    here = around(state, vehicle(200, 25.0, 18.0))
    after, latents = model.propagate(state, model.draw_latents(state, rngs[0]), here, STEP_S, rngs[0])
    alone, _ = short_term_driver().propagate(state, np.empty((0, 200)), here, STEP_S, rngs[1])
    np.testing.assert_array_equal(after, alone)
    assert not latents.any()


def test_a_particle_of_the_pair_that_means_to_leave_its_lane_arrives_in_the_next_one():
    model, state, rng = ShortTermPair(), states(500, 20.0, lat_m=3.4), np.random.default_rng(0)
    model = replace(model, rates=replace(model.rates, changes_per_s=0.0, seen_changes_per_s=0.0))
    state[LAT_SPEED] = 0.9
    latents = np.array([np.ones(500), np.full(500, 6.0)])
    for _ in range(60):
        state, latents = model.propagate(state, latents, in_lanes(state, 0, 1), STEP_S, rng)
    assert ((state[LAT] > 4.0) & (state[LAT] < 8.0)).mean() > 0.85


def test_some_particles_know_what_they_knew_among_all():
    state = states(10)
    all_of_them = around(state, vehicle(10, 5.0, 3.0))
    gaps = all_of_them.leader._replace(gap_m=np.arange(10.0))
    some = take_surroundings(type(all_of_them)(**{**vars(all_of_them), "leader": gaps}), np.array([2, 7]))
    np.testing.assert_array_equal(some.leader.gap_m, [2.0, 7.0])
    assert some.length_m.shape == (2,)
