import numpy as np
import pytest
from scipy.stats import multivariate_normal

from harness.trackers import kalman
from harness.trackers.kalman import LAT, LON, SPEED, GaussianStates, predict_constant_velocity, update_variable
from harness.trackers.rivals.gaussian import pairs_of
from harness.trackers.track_options import KalmanOptions
from mmpf.scan import Detections, EgoPose


def random_states(count: int, rng: np.random.Generator) -> GaussianStates:
    root = rng.normal(size=(count, 4, 4))
    return GaussianStates(rng.normal(size=(count, 4)), root @ root.transpose(0, 2, 1) + np.eye(4))


def correlated(count: int, rng: np.random.Generator) -> Detections:
    places = zip(("lon_m", "lat_m", "speed_mps"), rng.normal(size=(3, count)), strict=True)
    stds = zip(("std_lon_m", "std_lat_m", "std_speed_mps"), rng.uniform(0.2, 2.0, size=(3, count)), strict=True)
    return Detections(**dict(places), **dict(stds), correlation=rng.uniform(-0.9, 0.9, size=count))


def test_places_with_correlated_errors_and_speeds_are_taken_in_as_the_textbook_update_takes_them():
    rng = np.random.default_rng(0)
    states, found, index = random_states(5, rng), correlated(5, rng), np.arange(5)
    after = kalman.updated(states, index, found, index)
    matrix = np.eye(4)[[LON, LAT, SPEED]]
    for n in range(5):
        noise = np.diag([0.0, 0.0, found.std_speed_mps[n] ** 2])
        noise[:2, :2] = found.covariance_m2[n]
        gain = states.covariance[n] @ matrix.T @ np.linalg.inv(matrix @ states.covariance[n] @ matrix.T + noise)
        measured = np.array([found.lon_m[n], found.lat_m[n], found.speed_mps[n]])
        np.testing.assert_allclose(after.mean[n], states.mean[n] + gain @ (measured - matrix @ states.mean[n]))
        np.testing.assert_allclose(after.covariance[n], (np.eye(4) - gain @ matrix) @ states.covariance[n], atol=1e-12)


def test_new_beliefs_and_the_densities_of_places_know_how_errors_correlate():
    rng = np.random.default_rng(3)
    states, found = random_states(2, rng), correlated(3, rng)
    born = kalman.newborn(found, np.arange(3), EgoPose(0.0, 0.0, 0.0, 9.0, 4.5, 1.8), KalmanOptions())
    place = np.ix_(np.arange(3), [LON, LAT], [LON, LAT])
    np.testing.assert_allclose(born.covariance[place], found.covariance_m2)
    densities = pairs_of(states.mean, states.covariance, found)[1]
    for n, k in np.ndindex(2, 3):
        spread = states.covariance[n][np.ix_([LON, LAT], [LON, LAT])] + found.covariance_m2[k]
        expected = multivariate_normal(states.mean[n][[LON, LAT]], spread).logpdf([found.lon_m[k], found.lat_m[k]])
        assert densities[n, k] == pytest.approx(expected)


def test_vehicles_that_are_not_measured_keep_their_belief():
    rng = np.random.default_rng(1)
    states = random_states(4, rng)
    after = update_variable(states, np.array([2]), LON, np.array([7.0]), np.array([0.3]))
    untouched = [0, 1, 3]
    np.testing.assert_array_equal(after.mean[untouched], states.mean[untouched])
    assert after.covariance[2, LON, LON] < 0.3**2


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
