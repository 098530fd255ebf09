from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from harness.trackers.kalman import (
    LAT,
    LAT_SPEED,
    LON,
    SPEED,
    GaussianStates,
    predict_constant_velocity,
    update_variable,
)
from harness.trackers.rivals.imm import (
    ACCEL,
    CTRA,
    CV,
    TURN,
    Manoeuvres,
    ModelBeliefs,
    combined,
    mixed,
    predicted,
    stays,
    turned_and_accelerated,
    updated,
)
from mmpf.scan import Detections

MANOEUVRES = Manoeuvres(1.0, 0.1, 1.5, 0.1, 2.0)


def some_beliefs(count: int, probability: tuple[float, float], seed: int = 0) -> ModelBeliefs:
    rng = np.random.default_rng(seed)
    roots = rng.normal(0.0, 0.5, (count, 2, 6, 6))
    mean = rng.normal(0.0, 3.0, (count, 2, 6))
    mean[..., SPEED] += 12.0
    mean[..., TURN] *= 0.05
    return ModelBeliefs(mean, roots @ roots.swapaxes(-1, -2) + np.eye(6), np.tile(probability, (count, 1)))


def detections_at(places: np.ndarray, speed_mps: float = np.nan) -> Detections:
    std, speed = np.full(len(places), 0.3), np.full(len(places), speed_mps)
    return Detections(places[:, 0], places[:, 1], speed, std, std, 0.5 + 0.0 * speed)


@pytest.mark.parametrize("speed_mps", [np.nan, 11.0])
def test_it_is_a_kalman_filter_if_the_straight_model_has_all_the_weight(speed_mps):
    rng = np.random.default_rng(2)
    beliefs = some_beliefs(5, (1.0, 0.0))
    beliefs.covariance[:, :, :4, 4:] = beliefs.covariance[:, :, 4:, :4] = 0.0
    kalman = GaussianStates(beliefs.mean[:, CV, :4], beliefs.covariance[:, CV, :4, :4])
    index = np.arange(5)
    for _ in range(20):
        beliefs = predicted(mixed(beliefs, np.eye(2)), 0.1, MANOEUVRES)
        kalman = predict_constant_velocity(kalman, 0.1, 1.0, 0.1)
        found = detections_at(kalman.mean[:, [LON, LAT]] + rng.normal(0.0, 0.5, (5, 2)), speed_mps)
        beliefs = updated(beliefs, index, found, index)
        kalman = update_variable(kalman, index, LON, found.lon_m, found.std_lon_m)
        kalman = update_variable(kalman, index, LAT, found.lat_m, found.std_lat_m)
        if np.isfinite(speed_mps):
            kalman = update_variable(kalman, index, SPEED, found.speed_mps, found.std_speed_mps)
        mean, covariance = combined(beliefs)
        assert mean[:, :4] == pytest.approx(kalman.mean, abs=1e-9)
        assert covariance[:, :4, :4] == pytest.approx(kalman.covariance, abs=1e-9)


def test_mixing_keeps_what_a_plain_mixture_of_gaussians_keeps():
    beliefs, transition = some_beliefs(3, (0.7, 0.3)), np.array([[0.9, 0.1], [0.25, 0.75]])
    after = mixed(beliefs, transition)
    for n in range(3):
        for to in range(2):
            weights = [beliefs.probability[n, before] * transition[before, to] for before in range(2)]
            total = sum(weights)
            mean = sum(w * beliefs.mean[n, k] for k, w in enumerate(weights)) / total
            second = sum(
                w * (beliefs.covariance[n, k] + np.outer(beliefs.mean[n, k], beliefs.mean[n, k]))
                for k, w in enumerate(weights)
            )
            assert after.probability[n, to] == pytest.approx(total)
            assert after.mean[n, to] == pytest.approx(mean)
            assert after.covariance[n, to] == pytest.approx(second / total - np.outer(mean, mean))
    # Neither mixing nor the transition of models moves the mixture's mean.
    assert combined(after)[0] == pytest.approx(combined(beliefs)[0])


def test_models_gain_and_lose_by_bayes():
    beliefs = some_beliefs(1, (0.6, 0.4))
    found = detections_at(np.array([[1.0, -0.5]]))
    after = updated(beliefs, np.array([0]), found, np.array([0]))
    posterior = []
    for model in range(2):
        covariance = beliefs.covariance[0, model][np.ix_([LON, LAT], [LON, LAT])] + 0.09 * np.eye(2)
        off = np.array([1.0, -0.5]) - beliefs.mean[0, model, [LON, LAT]]
        density = np.exp(-0.5 * off @ np.linalg.solve(covariance, off)) / np.sqrt(np.linalg.det(2 * np.pi * covariance))
        posterior.append(beliefs.probability[0, model] * density)
    assert after.probability[0] == pytest.approx(np.array(posterior) / sum(posterior))


def test_a_turn_at_growing_speed_is_that_of_the_equations_of_motion():
    start = np.zeros(6)
    start[[LON, LAT, SPEED, LAT_SPEED, ACCEL, TURN]] = 3.0, -2.0, 9.0, 4.0, 1.2, 0.3
    fade_s = 1e9

    def motion(_, state):
        way = np.hypot(state[2], state[3])
        along = state[2:4] / way
        return [*state[2:4], *(1.2 * along + 0.3 * np.array([-state[3], state[2]]))]

    known = solve_ivp(motion, (0.0, 0.1), start[[LON, LAT, SPEED, LAT_SPEED]], rtol=1e-10).y[:, -1]
    later, _ = turned_and_accelerated(start[None], 0.1, fade_s)
    assert later[0, [LON, LAT]] == pytest.approx(known[:2], abs=1e-3)
    assert later[0, [SPEED, LAT_SPEED]] == pytest.approx(known[2:], abs=1e-9)


@pytest.mark.parametrize("speed", [(8.0, -3.0), (0.4, 0.3)])
def test_its_derivatives_are_those_of_small_differences(speed):
    state = np.array([1.0, speed[0], 2.0, speed[1], 0.8, -0.2])
    _, jacobian = turned_and_accelerated(state[None], 0.5, 2.0)
    for k in range(6):
        step = np.zeros(6)
        step[k] = 1e-6
        ahead, behind = (turned_and_accelerated((state + sign * step)[None], 0.5, 2.0)[0][0] for sign in (1, -1))
        assert jacobian[0][:, k] == pytest.approx((ahead - behind) / 2e-6, abs=1e-6)


def test_a_vehicle_that_turns_moves_the_weight_to_the_turning_model_and_back():
    manoeuvres, transition = MANOEUVRES, stays(0.1, (10.0, 3.0))
    rng = np.random.default_rng(1)
    beliefs = ModelBeliefs(np.zeros((1, 2, 6)), np.tile(np.eye(6), (1, 2, 1, 1)), np.array([[0.5, 0.5]]))
    beliefs.mean[..., SPEED] = 15.0
    x = y = heading = 0.0
    weight = []
    for k in range(150):
        heading += 0.04 if 50 <= k < 100 else 0.0
        x, y = x + 1.5 * np.cos(heading), y + 1.5 * np.sin(heading)
        beliefs = predicted(mixed(beliefs, transition), 0.1, manoeuvres)
        found = detections_at(np.array([[x, y]]) + rng.normal(0.0, 0.1, 2))
        beliefs = updated(beliefs, np.array([0]), found, np.array([0]))
        weight.append(beliefs.probability[0, CTRA])
    assert np.mean(weight[60:100]) > 0.8
    assert np.mean(weight[20:50]) < 0.5


def test_how_long_models_last_is_what_was_asked_for():
    long, short = stays(1000.0, (10.0, 3.0)), stays(0.1, (10.0, 3.0))
    assert long == pytest.approx(np.tile([10 / 13, 3 / 13], (2, 1)))
    assert np.linalg.matrix_power(short, 10) == pytest.approx(stays(1.0, (10.0, 3.0)))
    assert short.sum(axis=1) == pytest.approx(1.0)
