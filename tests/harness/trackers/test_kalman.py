import numpy as np
import pytest

from harness.trackers.kalman import LAT, LON, SPEED, GaussianStates, predict_constant_velocity, update_variable


def random_states(count: int, rng: np.random.Generator) -> GaussianStates:
    root = rng.normal(size=(count, 4, 4))
    return GaussianStates(rng.normal(size=(count, 4)), root @ root.transpose(0, 2, 1) + np.eye(4))


def test_measuring_three_variables_one_by_one_equals_the_textbook_update_with_all_at_once():
    rng = np.random.default_rng(0)
    states = random_states(5, rng)
    measured, std = rng.normal(size=(5, 3)), rng.uniform(0.2, 2.0, size=(5, 3))
    index = np.arange(5)
    updated = states
    for column, variable in enumerate((LON, LAT, SPEED)):
        updated = update_variable(updated, index, variable, measured[:, column], std[:, column])
    matrix = np.eye(4)[[LON, LAT, SPEED]]
    for n in range(5):
        innovation_covariance = matrix @ states.covariance[n] @ matrix.T + np.diag(std[n] ** 2)
        gain = states.covariance[n] @ matrix.T @ np.linalg.inv(innovation_covariance)
        mean = states.mean[n] + gain @ (measured[n] - matrix @ states.mean[n])
        covariance = (np.eye(4) - gain @ matrix) @ states.covariance[n]
        np.testing.assert_allclose(updated.mean[n], mean, atol=1e-12)
        np.testing.assert_allclose(updated.covariance[n], covariance, atol=1e-12)


def test_vehicles_that_are_not_measured_keep_their_belief():
    rng = np.random.default_rng(1)
    states = random_states(4, rng)
    updated = update_variable(states, np.array([2]), LON, np.array([7.0]), np.array([0.3]))
    untouched = [0, 1, 3]
    np.testing.assert_array_equal(updated.mean[untouched], states.mean[untouched])
    assert updated.covariance[2, LON, LON] < 0.3**2


def test_predicting_in_two_halves_equals_predicting_once():
    states = random_states(3, np.random.default_rng(2))
    once = predict_constant_velocity(states, 1.0, 2.0, 0.3)
    halves = predict_constant_velocity(predict_constant_velocity(states, 0.4, 2.0, 0.3), 0.6, 2.0, 0.3)
    np.testing.assert_allclose(halves.mean, once.mean)
    np.testing.assert_allclose(halves.covariance, once.covariance)


def test_a_known_speed_moves_the_position_by_speed_times_time():
    states = GaussianStates(np.array([[10.0, 20.0, 1.0, -0.5]]), np.zeros((1, 4, 4)))
    predicted = predict_constant_velocity(states, 2.0, 1.0, 1.0)
    assert predicted.mean[0] == pytest.approx([50.0, 20.0, 0.0, -0.5])
    assert predicted.std[0, LON] == pytest.approx(np.sqrt(8.0 / 3.0))
