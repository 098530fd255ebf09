"""What is reported of each component: its state word, mean and spread, or nothing at all."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.motion.standing import STANDS_MPS
from mmpf.motion.state import ACCEL, LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray
from mmpf.options.filter import ReportingOptions
from mmpf.scan import SensorModel
from mmpf.stages.reporting import followed_speed_variance, reported_tracks
from mmpf.tracks import TRACK_STATES, Tracks
from tests.mmpf.scenes import belief_of, spot

OPTIONS = ReportingOptions(hidden_after_s=0.25, reported_std_lon_m=6.0)


def reported(mixture: Mixture) -> Tracks:
    return reported_tracks(mixture, component_moments(mixture), OPTIONS, SensorModel())


def pair_apart(std_lon_m: float) -> FloatArray:
    state = spot(50.0, 5.0, particles=2)
    state[LON] += [-std_lon_m, std_lon_m]
    return state


@pytest.mark.parametrize(
    ("confirmed", "unseen_s", "word"),
    [
        (False, 0.0, "tentative"),
        (True, 0.0, "confirmed"),
        (True, 0.2, "confirmed"),
        (True, 0.3, "hidden"),
        (False, 0.3, "tentative"),
    ],
)
def test_a_track_is_tentative_until_confirmed_and_hidden_when_unseen_for_long(
    confirmed: bool, unseen_s: float, word: str
) -> None:
    tracks = reported(belief_of([spot(10.0, 5.0)], confirmed=[confirmed], unseen_s=[unseen_s]))
    assert [TRACK_STATES[state] for state in tracks.state] == [word]


@pytest.mark.parametrize(("std_lon_m", "unseen_s", "count"), [(5.9, 3.0, 1), (6.1, 3.0, 0), (6.1, 0.0, 1)])
def test_one_that_is_unseen_and_may_be_anywhere_is_withheld(std_lon_m: float, unseen_s: float, count: int) -> None:
    belief = belief_of([pair_apart(std_lon_m)], confirmed=[True], unseen_s=[unseen_s])
    assert len(reported(belief)) == count


def test_the_deviations_of_one_that_may_follow_another_source_are_those_of_the_mixture_of_both_cases() -> None:
    belief = belief_of([pair_apart(2.0)], unseen_s=[1.0], mistaken=[0.25], away_std=[[10.0, 3.0, 0.0]])
    tracks, factor = reported(belief), OPTIONS.hidden_variance_factor
    assert np.hstack([tracks.std_lon_m, tracks.std_lat_m]) ** 2 / factor == pytest.approx([0.75 * 4 + 25, 1.5**2])


@pytest.mark.parametrize(("speed_mps", "least_mps"), [(0.0, STANDS_MPS), (0.29, STANDS_MPS), (0.31, 0.0)])
def test_the_speed_of_one_that_counts_as_standing_is_known_no_better(speed_mps: float, least_mps: float) -> None:
    tracks = reported(belief_of([spot(10.0, 5.0, speed_mps)]))
    assert tracks.std_speed_mps == pytest.approx(least_mps, abs=1e-5)


def test_what_is_withheld_takes_nothing_of_the_others_with_it() -> None:
    belief = belief_of(
        [spot(10.0, 1.0), pair_apart(9.0), spot(30.0, 3.0)],
        track_id=[4, 5, 6],
        confirmed=[True, True, False],
        unseen_s=[0.0, 2.0, 0.0],
        existence=[0.9, 0.8, 0.7],
    )
    tracks = reported(belief)
    assert tracks.track_id.tolist() == [4, 6]
    assert tracks.lon_m == pytest.approx([10.0, 30.0])
    assert tracks.lat_m == pytest.approx([1.0, 3.0])
    assert tracks.existence.tolist() == [0.9, 0.7]
    assert [TRACK_STATES[state] for state in tracks.state] == ["confirmed", "tentative"]


def test_means_and_spreads_are_those_of_the_weighted_particles() -> None:
    state = np.random.default_rng(0).normal(10.0, 3.0, (6, 40))
    weight = np.random.default_rng(1).uniform(0.1, 1.0, 40)
    weight /= weight.sum()
    tracks = reported(belief_of([state], [weight]))
    mean = state @ weight
    std = np.sqrt((state - mean[:, None]) ** 2 @ weight)
    names = ("lon_m", "lat_m", "speed_mps", "lat_speed_mps", "accel_mps2")
    for name, row in zip(names, (LON, LAT, SPEED, LAT_SPEED, ACCEL), strict=True):
        assert getattr(tracks, name) == pytest.approx(mean[[row]]), name
    for name, row in (("std_lon_m", LON), ("std_lat_m", LAT), ("std_speed_mps", SPEED)):
        assert getattr(tracks, name) == pytest.approx(std[[row]]), name


def test_no_spread_is_zero_even_if_all_particles_are_in_one_place() -> None:
    tracks = reported(belief_of([spot(10.0, 5.0)]))
    assert [*tracks.std_lon_m, *tracks.std_lat_m, *tracks.std_speed_mps] == pytest.approx([1e-6] * 3)


@pytest.mark.parametrize("correlation_s", [0.2, 1.0, 3.0])
@pytest.mark.parametrize("accel_density", [0.5, 20.0])
def test_the_drift_that_a_kalman_filter_takes_for_speed_is_as_large_as_lyapunovs_equation_says(
    correlation_s: float, accel_density: float
) -> None:
    dt_s, noise_m2, drift_m2 = 0.002, 0.1, 0.05
    step, seen = np.array([[1.0, dt_s], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    kicks = accel_density * np.array([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]])
    before = solve_discrete_are(step.T, seen.T, kicks, np.array([[noise_m2]]))
    gain = before @ seen.T / (before[0, 0] + noise_m2)
    after = (np.eye(2) - gain @ seen) @ before
    # The filter's error when the vehicle stands at zero and each measurement is the drift alone.
    kept = np.exp(-dt_s / correlation_s)
    both = np.zeros((3, 3))
    both[:2, :2], both[:2, 2:], both[2, 2] = (np.eye(2) - gain @ seen) @ step, kept * gain, kept
    into = np.vstack([gain, [[1.0]]])
    error = solve_discrete_lyapunov(both, drift_m2 * (1.0 - kept**2) * into @ into.T)
    found = followed_speed_variance(*after.diagonal()[:, None], np.array([drift_m2]), correlation_s)
    assert found == pytest.approx(error[1, 1], rel=0.03)
