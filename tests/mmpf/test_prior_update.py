"""The prior update: particles moved by the model, and the noise that the filter adds to its prediction."""

from dataclasses import replace

import numpy as np
import pytest

from mmpf.belief.mixture import Mixture
from mmpf.motion.state import ACCEL, LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray
from mmpf.options.filter import ModelErrorOptions
from mmpf.stages.prediction import bootstrap_proposal, prior_update
from tests.mmpf.motion.surroundings import around
from tests.mmpf.scenes import LinearGaussianMotion, belief_of, spot
from tests.mmpf.test_update_rules import situation_with

PARTICLES = 200_000
DT_S = 0.5
MEAN = np.array([100.0, 5.0, 20.0, 0.2, 0.5, 0.0])
NO_ERROR = ModelErrorOptions(speed=0.0, accel=0.0, lat_speed=0.0)


def correlated_normal(covariance: FloatArray) -> FloatArray:
    rng = np.random.default_rng(1)
    return MEAN[:, None] + np.linalg.cholesky(covariance) @ rng.standard_normal((6, PARTICLES))


def moved(mixture: Mixture, error: ModelErrorOptions, speed_std_mps: float = 0.0, *, hidden: bool = False) -> Mixture:
    return prior_update(
        mixture,
        around(mixture.cloud.state, hidden=hidden),
        replace(situation_with([]), motion=LinearGaussianMotion(speed_std_mps), dt_s=DT_S),
        bootstrap_proposal,
        error,
        np.random.default_rng(2),
    )


def test_a_linear_model_moves_mean_and_covariance_as_in_closed_form() -> None:
    factor = np.random.default_rng(0).normal(0.0, 0.6, (6, 6))
    covariance = factor @ factor.T + 0.1 * np.eye(6)
    after = moved(belief_of([correlated_normal(covariance)]), NO_ERROR, speed_std_mps=0.4).cloud.state
    transition = np.eye(6)
    transition[LON, SPEED] = transition[LAT, LAT_SPEED] = DT_S
    transition[ACCEL, ACCEL] = transition[5, 5] = 0.0
    noise = np.zeros(6)
    noise[[SPEED, LAT_SPEED]] = 0.4**2, 0.04**2
    expected = transition @ covariance @ transition.T + np.diag(noise)
    bound = 5.0 * np.sqrt(np.diag(expected) / PARTICLES) + 1e-12
    assert (np.abs(after.mean(axis=1) - transition @ MEAN) < bound).all()
    assert np.cov(after) == pytest.approx(expected, abs=0.02 * np.diag(expected).max())


@pytest.mark.parametrize(("hidden", "factor"), [(False, 1.0), (True, 1.3)])
def test_the_models_error_grows_with_the_root_of_time_and_is_greater_along_the_road_while_hidden(
    hidden: bool, factor: float
) -> None:
    error = ModelErrorOptions(speed=0.4, accel=0.6, lat_speed=0.2)
    after = moved(belief_of([spot(0.0, 5.0, 20.0, PARTICLES)]), error, hidden=hidden).cloud.state
    expected = np.zeros(6)
    expected[[SPEED, ACCEL, LAT_SPEED]] = np.sqrt(DT_S) * np.array([0.4 * factor, 0.6 * factor, 0.2])
    assert after.std(axis=1) == pytest.approx(expected, rel=0.01, abs=1e-9)
    assert np.abs(np.corrcoef(after[[SPEED, ACCEL, LAT_SPEED]]) - np.eye(3)).max() < 0.01


def test_no_particle_drives_in_reverse_whatever_is_added_to_its_speed() -> None:
    after = moved(belief_of([spot(0.0, 5.0, 0.1, 1000)]), ModelErrorOptions(speed=2.0)).cloud.state
    assert after[SPEED].min() == 0.0
    assert (after[SPEED] == 0.0).mean() == pytest.approx(0.5, abs=0.1)


def test_weights_start_from_the_ratio_of_prior_and_proposal_and_components_grow_older() -> None:
    ratio = np.linspace(-1.0, 1.0, 10)

    def proposal(motion, state, latents, surroundings, scan, dt_s, rng):  # type: ignore[no-untyped-def]
        return state + 1.0, latents, ratio

    mixture = belief_of([spot(0.0, 5.0)], age_s=[0.4])
    after = prior_update(
        mixture,
        around(mixture.cloud.state),
        replace(situation_with([]), motion=LinearGaussianMotion(), dt_s=DT_S),
        proposal,
        NO_ERROR,
        np.random.default_rng(0),
    )
    assert after.cloud.log_raw_weight == pytest.approx(np.log(0.1) + ratio)
    assert after.cloud.log_weight == pytest.approx(np.full(10, np.log(0.1)))
    assert (after.cloud.state == mixture.cloud.state + 1.0).all()
    assert after.components.age_s == pytest.approx([0.4 + DT_S])
