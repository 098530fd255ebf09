"""The studies' filter, scores and pages, against closed forms and brute force."""

import json

import numpy as np
import pytest

from harness.lab.study.figures import draw_study
from harness.lab.study.study import COMPLETE, PARTIAL, run_study
from harness.lab.study.study_text import as_json, as_markdown
from harness.lab.windows.car_following import following_windows
from harness.lab.windows.cases import Cases, following_cases
from harness.lab.windows.filtering import follow, measure, score, weighted_crps
from mmpf.motion.kinematic import ProcessNoise, kinematic
from mmpf.motion.state import LON, SPEED
from tests.harness.lab.windows.test_windows import ROAD, steady, traffic

STEP_S = 0.1


@pytest.fixture(scope="module")
def cases() -> Cases:
    convoy = [(40.0 * k, 10.0, steady(2.0)) for k in range(6)]
    windows = following_windows(traffic(*convoy, steps=101), ROAD, 51)
    return following_cases(windows, 5, np.random.default_rng(0))


def brute_crps(values, true):
    return np.abs(values - true).mean() - 0.5 * np.abs(values[:, None] - values[None, :]).mean()


def test_crps_equals_its_definition_by_pairs():
    rng = np.random.default_rng(0)
    values, true = rng.normal(size=(3, 40)), rng.normal(size=3)
    scored = weighted_crps(values, np.full((3, 40), 1 / 40), true)
    np.testing.assert_allclose(scored, [brute_crps(v, t) for v, t in zip(values, true, strict=True)])


def test_crps_counts_a_particle_of_double_weight_twice():
    values, true = np.array([[1.0, 2.0, 5.0]]), np.array([2.5])
    double = weighted_crps(values, np.array([[0.25, 0.5, 0.25]]), true)
    np.testing.assert_allclose(double, [brute_crps(np.array([1.0, 2.0, 2.0, 5.0]), 2.5)])


def test_without_measurements_particles_start_at_the_truth_and_spread(cases):
    clouds = list(follow(kinematic("cvm", ProcessNoise(0.5, 0.0)), cases, 4000, np.random.default_rng(0)))
    assert len(clouds) == 50
    last = clouds[-1].state[SPEED].std(axis=1)
    np.testing.assert_allclose(last, 0.5 * np.sqrt(5.0), rtol=0.1)


def test_the_filter_agrees_with_the_kalman_filter_for_constant_velocity(cases):
    z = measure(cases, np.random.default_rng(1))
    density = 0.5
    clouds = list(follow(kinematic("cvm", ProcessNoise(density, 0.1)), cases, 5_000, np.random.default_rng(2), z))
    f = np.array([[1.0, STEP_S], [0.0, 1.0]])
    gain_of_noise = np.array([[STEP_S / 2], [1.0]])
    q = density**2 * STEP_S * gain_of_noise @ gain_of_noise.T
    mean, covariance = cases.truth[0, [LON, SPEED], 0], np.zeros((2, 2))
    for step in range(1, cases.steps):
        mean, covariance = f @ mean, f @ covariance @ f.T + q
        gain = covariance @ np.linalg.inv(covariance + np.diag([4.0, 4.0]))
        mean = mean + gain @ (z[step, [0, 2], 0] - mean)
        covariance = (np.eye(2) - gain) @ covariance
    particles, weight = clouds[-1].state[:, 0], clouds[-1].weight[0]
    estimate = particles[[LON, SPEED]] @ weight
    assert np.abs(estimate - mean).max() < 0.1
    assert (particles[LON] - estimate[0]) ** 2 @ weight == pytest.approx(covariance[0, 0], rel=0.15)


def test_a_right_model_covers_the_truth_and_errs_little(cases):
    scores = score(follow(kinematic("cvm", ProcessNoise(0.3, 0.05)), cases, 500, np.random.default_rng(0)), cases)
    assert scores.covered["lon_m"].all()
    assert scores.abs_error["lon_m"].max() < 0.5


@pytest.fixture(scope="module")
def result(cases):
    models = {"gmm": kinematic("cam"), "cvm": kinematic("cvm"), "cam": kinematic("cam")}
    return run_study("lane-keeping", cases, models, particles=50, seed=0, progress=lambda: None)


def test_rows_carry_the_agreed_columns(result):
    wanted = {
        *("study", "occlusion", "model", "horizon_s", "lon_m", "lon_m_ci95", "lat_m"),
        *("speed_mps", "speed_mps_ci95", "lat_speed_mps", "n"),
    }
    assert all(wanted <= set(row) for row in result.rows)
    assert {row["horizon_s"] for row in result.rows} == {1.0, 2.0, 5.0, None}


def test_the_same_seed_gives_the_same_rows(result, cases):
    models = {"gmm": kinematic("cam"), "cvm": kinematic("cvm"), "cam": kinematic("cam")}
    again = run_study("lane-keeping", cases, models, particles=50, seed=0, progress=lambda: None)
    assert again.rows == result.rows


def test_a_sentence_names_the_models_by_their_error_at_the_longest_horizon_before_the_table(result):
    page = as_markdown(result, {"seed": 0})
    for occlusion in (PARTIAL, COMPLETE):
        rows = [row for row in result.rows if row["occlusion"] == occlusion and row["horizon_s"] == 5.0]
        last = {row["model"]: row["lon_m"] for row in rows}
        told = page.partition(f"## {occlusion.capitalize()} occlusion")[2].split("\n")[2]
        assert told.startswith("After 5 s ")
        named = [model for _, model in sorted((told.index(f" {model} "), model) for model in last)]
        assert named == sorted(last, key=last.__getitem__)


@pytest.mark.slow
def test_a_studys_numbers_are_json_and_its_pictures_are_of_each_occlusion(result, tmp_path):
    assert len(json.loads(json.dumps(as_json(result.rows, {"seed": 0})))["results"]) == len(result.rows)
    names = {path.name for path in draw_study(result, tmp_path) if path.is_file()}
    assert names == {f"lane-keeping-{o}-{k}.png" for o in (PARTIAL, COMPLETE) for k in ("errors", "particles")}
