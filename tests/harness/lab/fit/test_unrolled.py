"""Fitting to whole rollouts: gradient against differences, score against a plain loop, fit on known drivers."""

from dataclasses import replace

import numpy as np
import pytest

from harness.lab.fit.unrolled import crps_and_slope, fit_residual, initial_weights, rollouts_of, score_and_gradient
from harness.lab.windows.car_following import CarFollowing
from harness.lab.windows.cases import cases_of
from harness.lab.windows.filtering import follow, score
from harness.lab.windows.neighbours import NeighbourStates
from mmpf.motion.learned.driver import with_follower
from mmpf.motion.learned.residual import INPUTS, SEEN, NetworkWeights, ResidualFollower

STEPS = 101


def windows(count, rng, gap_m=20.0, pull=0.0):
    """Followers of a leader at 12 m/s, each with an acceleration of its own that fades."""
    time_s = 0.1 * np.arange(STEPS)[None]
    own = pull * rng.standard_normal((count, 1))
    accel = own * np.exp(-time_s / 2.0)
    speed = 12.0 + np.cumsum(np.hstack([np.zeros((count, 1)), accel[:, :-1]]), axis=1) * 0.1
    lon = np.cumsum(np.hstack([np.zeros((count, 1)), 0.05 * (speed[:, 1:] + speed[:, :-1])]), axis=1)
    leader_speed = np.full((count, STEPS), 12.0)
    nothing, lengths = np.zeros((count, STEPS)), np.full(count, 5.0)
    leader_lon = gap_m + 5.0 + 12.0 * time_s + nothing
    follower = lon, nothing, speed, nothing, accel, lengths, lengths
    leader = NeighbourStates(leader_lon, leader_speed, nothing, nothing + 5.0)
    return CarFollowing(*follower, leader, np.arange(count), np.zeros(count, dtype=np.bool_), np.arange(count))


def test_the_gradient_through_a_rollout_is_that_of_differences():
    rng = np.random.default_rng(0)
    rollouts = rollouts_of(windows(3, rng, pull=0.5), np.arange(3), 4, rng)
    exact = {name: v if v.dtype == np.bool_ else v.astype(np.float64) for name, v in vars(rollouts).items()}
    rollouts = replace(rollouts, **(exact | {"led": np.arange(len(rollouts.led)) >= 4}))
    ranges = (np.full(SEEN, -50.0), np.full(SEEN, 100.0), np.full(SEEN, 2.0), np.full(SEEN, 3.0))
    scaling = NetworkWeights(*ranges, *[np.zeros(1)] * 7)
    weights = {name: w.astype(np.float64) for name, w in initial_weights(rng, 5).items()}
    weights["w3"] *= 10.0
    _, gradient = score_and_gradient(weights, scaling, rollouts)
    for name, values in weights.items():
        place = tuple(int(rng.integers(size)) for size in values.shape)
        either = []
        for way in (1e-6, -1e-6):
            moved = values.copy()
            moved[place] += way
            either.append(score_and_gradient(weights | {name: moved}, scaling, rollouts)[0])
        assert gradient[name][place] == pytest.approx((either[0] - either[1]) / 2e-6, rel=1e-3, abs=1e-6)


def test_the_score_is_that_of_a_plain_loop():
    rng = np.random.default_rng(1)
    particles, true = rng.standard_normal((2, 3 * 4)), rng.standard_normal((2, 3))
    found, _ = crps_and_slope(particles, true)
    for step in range(2):
        scores = []
        for case in range(3):
            mine = particles[step, 4 * case : 4 * case + 4]
            apart = [abs(a - b) for a in mine for b in mine]
            scores.append(np.mean([abs(a - true[step, case]) for a in mine]) - sum(apart) / (2 * 4 * 3))
        assert found[step, 0] == pytest.approx(np.mean(scores))


def assert_learned(model, rng):
    """Ask for less error than at constant speed, and that the truth lies within what is drawn."""
    cases = cases_of(windows(30, rng, 40.0, 0.3))
    scores = score(follow(replace(model, changes_lanes=False), cases, 50, np.random.default_rng(0)), cases)
    coasting = np.abs(cases.truth[50, 0] - cases.truth[0, 2] * 5.0).mean()
    assert scores.abs_error["lon_m"][49].mean() < coasting
    assert scores.covered["lon_m"][49].mean() > 0.6


@pytest.mark.slow
def test_the_fit_learns_what_drivers_do_and_how_they_differ(monkeypatch):
    monkeypatch.setattr("harness.lab.fit.unrolled.WINDOWS", 40)
    rng = np.random.default_rng(2)
    network = fit_residual(windows(100, rng, gap_m=40.0, pull=0.3), 0, lambda line: None, iterations=60)
    assert network.w1.shape[0] == INPUTS
    assert_learned(with_follower(ResidualFollower(network), "residual"), rng)
