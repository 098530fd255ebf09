"""What hidden vehicles cost, against every assignment tried one by one."""

import itertools

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from harness.analysis.curves import sums_and_weights
from harness.scoring.metrics.hidden_cost import CRPS, gaussian_crps
from harness.scoring.metrics.registry import view
from tests.harness.scoring.scenes import Scene, score_run

CUTOFF_M = 10.0
SEEN, UNSEEN = list(range(5)), list(range(5, 10))
STEPS = len(SEEN) + len(UNSEEN)


def hiding(scene: Scene, name: str, lon: float, lat: float = 0.0, detections: int = 5) -> Scene:
    """Add a vehicle that is detected in its last steps in sight and hidden afterwards."""
    step = np.arange(STEPS)
    detected = (step < len(SEEN)) & (step >= len(SEEN) - detections)
    return scene.vehicle(name, lon, lat, np.where(step < len(SEEN), "visible", "hidden"), detected)


def hidden_scores(scene: Scene) -> dict:
    return score_run(*scene.tables()).metrics["hidden"]


def least_cost(vehicles, tracks) -> tuple[list[float], int]:
    """Try every way to give vehicles tracks or none; return each vehicle's distance and how many tracks are left."""
    best, left = None, 0
    places = [*range(len(tracks)), *[-1] * len(vehicles)]
    for choice in set(itertools.permutations(places, len(vehicles))):
        costs = [
            CUTOFF_M if k < 0 else min(CUTOFF_M, float(np.hypot(*(v - tracks[k]))))
            for v, k in zip(vehicles, choice, strict=True)
        ]
        if best is None or sum(costs) < sum(best) - 1e-12:
            served = sum(cost < CUTOFF_M for cost in costs)
            best, left = costs, len(tracks) - served
    return best or [], left


@pytest.mark.parametrize("seed", range(25))
def test_cost_and_false_tracks_are_those_of_the_best_of_all_assignments(seed):
    rng = np.random.default_rng(seed)
    cars, guesses = rng.uniform(20, 45, (3, 2)) * [1, 0.2], rng.uniform(20, 45, (4, 2)) * [1, 0.2]
    scene = Scene(STEPS)
    for number, (lon, lat) in enumerate(cars):
        if number:
            hiding(scene, f"car{number}", lon, lat)
        else:
            scene.vehicle("seen", lon, lat, detected=True)
    for number, (lon, lat) in enumerate(guesses):
        scene.track(number, lon, lat, at=UNSEEN)
    costs, left = least_cost(cars, guesses)
    told = score_run(*scene.tables()).metrics
    assert told["hidden"]["hidden_cost_m"] == pytest.approx(np.mean(costs[1:]))
    assert told["hidden"]["n"] == 2 * len(UNSEEN)

    gospa, share = told["gospa_remembered"], len(UNSEEN) / STEPS
    asked_before = 3  # Steps in sight from the third detection on, in which nothing is reported.
    lost = sum(cost == CUTOFF_M for cost in costs)
    assert gospa["localisation"] == pytest.approx(share * sum(cost for cost in costs if cost < CUTOFF_M))
    assert gospa["missed"] == pytest.approx(0.5 * CUTOFF_M * (share * lost + 3 * asked_before / STEPS))
    assert gospa["false"] == pytest.approx(0.5 * CUTOFF_M * share * left)
    assert gospa["mean"] == pytest.approx(gospa["localisation"] + gospa["missed"] + gospa["false"])


def test_vehicles_detected_twice_are_not_asked_for_and_their_tracks_not_false():
    told = hidden_scores(hiding(Scene(STEPS), "glimpsed", 30.0, detections=2).track(1, 30.0, at=range(3, 10)))
    assert (told["n"], told["hidden_cost_m"], told["false_hidden_tracks_per_scan"]) == (0, None, 0.0)


@pytest.mark.parametrize(("renamed_every", "in_sight"), [(30, 8), (5, 5), (2, 4), (1, 3)])
def test_a_track_out_of_sight_that_follows_nobody_is_false_by_any_name_and_one_in_sight_is_not(renamed_every, in_sight):
    """Half a second after its last detection a track is out of sight; under a new name it has had none."""
    scene = Scene(30).clutter(range(3), 50.0)
    for begin in range(0, 30, renamed_every):
        scene.track(begin, 50.0, at=range(begin, begin + renamed_every))
    assert hidden_scores(scene)["false_hidden_tracks_per_scan"] == pytest.approx((30 - in_sight) / 30)


def test_a_vehicle_beyond_the_memory_excuses_the_track_that_is_still_on_it():
    steps = 130
    state = np.where(np.arange(steps) < 5, "visible", "hidden")
    scene = Scene(steps).vehicle("gone", 30.0, state=state, detected=np.arange(steps) < 5).track(1, 30.0)
    told = hidden_scores(scene)
    assert (told["n"], told["hidden_cost_m"], told["false_hidden_tracks_per_scan"]) == (100, 0.0, 0.0)


def test_tracks_that_change_vehicles_cost_by_identity_alone():
    scene = hiding(hiding(Scene(STEPS), "left", 20.0), "right", 60.0)
    step = np.arange(STEPS)
    scene.track(1, np.where(step < 5, 20.0, 60.0)).track(2, np.where(step < 5, 60.0, 20.0))
    told = hidden_scores(scene)
    assert told["hidden_cost_m"] == 0.0
    assert told["identity_cost_m"] == CUTOFF_M
    assert told["followed_percent"] == 100.0


@pytest.mark.parametrize(("error_m", "std_m"), [(0.0, 1.0), (1.5, 0.7), (-6.0, 2.0), (3.0, 40.0)])
def test_the_ranked_probability_score_is_the_integral_of_its_definition(error_m, std_m):
    """Of the squared difference between the stated distribution function and the step at the truth, here 0."""
    below = quad(lambda x: norm.cdf(x, error_m, std_m) ** 2, -np.inf, 0.0)[0]
    above = quad(lambda x: norm.sf(x, error_m, std_m) ** 2, 0.0, np.inf)[0]
    assert gaussian_crps(np.array([error_m]), np.array([std_m])) == pytest.approx(below + above, abs=1e-6)


def test_without_a_deviation_the_ranked_probability_score_is_the_absolute_error_and_the_right_one_makes_it_least():
    error_m = np.random.default_rng(0).normal(0.0, 2.0, 20_000)
    for std_m in (0.0, np.nan):
        assert gaussian_crps(error_m, np.full(20_000, std_m)).tolist() == np.abs(error_m).tolist()
    means_m = [gaussian_crps(error_m, np.full(20_000, std_m)).mean() for std_m in (0.4, 1.6, 2.0, 2.4, 10.0)]
    assert np.argmin(means_m) == 2
    assert means_m[2] == pytest.approx(2.0 / np.sqrt(np.pi), rel=0.02)


def test_deviations_that_are_too_large_or_too_small_raise_the_ranked_probability_score_alone():
    def told(std_m: float) -> dict:
        return hidden_scores(hiding(hiding(Scene(STEPS), "kept", 30.0), "lost", 80.0).track(1, 32.0, 1.0, std=std_m))

    right, large, small, exact, endless = (told(std_m) for std_m in (2.0, 10.0, 0.4, 0.0, 1e6))
    score_m = 2.0 * (norm.cdf(1.0) - norm.cdf(-1.0) + 2.0 * norm.pdf(1.0) - 1.0 / np.sqrt(np.pi))
    assert right["hidden_crps_m"] == pytest.approx(0.5 * (score_m + CUTOFF_M))
    assert min(large["hidden_crps_m"], small["hidden_crps_m"]) > right["hidden_crps_m"] + 0.2
    assert (exact["hidden_crps_m"], endless["hidden_crps_m"]) == (0.5 * (2.0 + CUTOFF_M), CUTOFF_M)
    assert {each["hidden_cost_m"] for each in (large, small, exact, endless)} == {right["hidden_cost_m"]}


@pytest.mark.parametrize(("direction_rad", "error_m", "std_m"), [(-0.7, 1.0, 0.5), (3.0, 1.0, 0.5), (2.0, 3.0, 4.0)])
def test_in_the_plane_the_axis_nearer_to_the_vehicles_direction_is_scored(direction_rad, error_m, std_m):
    truth, detections, tracks = hiding(Scene(STEPS), "car", 30.0).track(1, 31.0, 3.0).tables()
    tables = truth.assign(direction_rad=direction_rad), detections, tracks.assign(std_lon_m=0.5, std_lat_m=4.0)
    expected_m = gaussian_crps(np.array([error_m]), np.array([std_m]))[0]
    assert score_run(*tables).metrics["hidden"]["hidden_crps_m"] == pytest.approx(expected_m)


def test_runs_are_pooled_by_their_hidden_vehicle_steps():
    sums, weights = sums_and_weights(pd.DataFrame({CRPS: [1.0, 3.0], "hidden.n": [10, 30]}), view([CRPS])[0])
    assert sums.sum() / weights.sum() == 2.5
