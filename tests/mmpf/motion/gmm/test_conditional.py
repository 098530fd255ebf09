"""The conditional mixture against direct computation, scikit-learn's joint density, and the moments of its samples."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal
from sklearn.mixture import GaussianMixture

from mmpf.motion.gmm.conditional import ConditionalGmm, InvalidMixtureError, expand
from mmpf.motion.gmm.kernel import Scaling
from mmpf.motion.gmm.scaled import ScaledGmm

INPUTS, OUTPUTS, COMPONENTS = 5, 4, 7


@pytest.fixture(scope="module")
def mixture() -> ConditionalGmm:
    rng = np.random.default_rng(3)
    size = INPUTS + OUTPUTS
    root = 0.4 * rng.normal(size=(COMPONENTS, size, size))
    weights = rng.dirichlet(np.full(COMPONENTS, 3.0))
    covariances = root @ root.transpose(0, 2, 1) + 0.05 * np.eye(size)
    return ConditionalGmm(weights, rng.normal(size=(COMPONENTS, size)), covariances, INPUTS)


@pytest.fixture(scope="module")
def x() -> np.ndarray:
    return np.random.default_rng(4).normal(size=(50, INPUTS))


def direct_weights(mixture: ConditionalGmm, x: np.ndarray) -> np.ndarray:
    densities = np.stack(
        [
            weight * multivariate_normal(mean[:INPUTS], covariance[:INPUTS, :INPUTS]).pdf(x)
            for weight, mean, covariance in zip(mixture.weights, mixture.means, mixture.covariances, strict=True)
        ],
        axis=1,
    )
    return densities / densities.sum(axis=1, keepdims=True)


def test_the_expanded_input_of_five_numbers_has_twenty_one_entries_and_that_of_fourteen_a_hundred_and_twenty():
    assert expand(np.zeros((1, 5))).shape == (1, 21)
    assert expand(np.zeros((1, 14))).shape == (1, 120)


def test_conditional_density_is_scikit_learns_joint_density_over_its_marginal(mixture, x):
    y = np.random.default_rng(5).normal(size=(len(x), OUTPUTS))
    joint = _as_sklearn(mixture.weights, mixture.means, mixture.covariances)
    marginal = _as_sklearn(mixture.weights, mixture.means[:, :INPUTS], mixture.covariances[:, :INPUTS, :INPUTS])
    expected = joint.score_samples(np.hstack([x, y])) - marginal.score_samples(x)
    np.testing.assert_allclose(mixture.log_density(x, y), expected, atol=1e-8)


def sampled(mixture: ConditionalGmm, point: np.ndarray, draws: int, seed: int) -> np.ndarray:
    p, q = np.ones(mixture.inputs), np.ones(mixture.outputs)
    unscaled = ScaledGmm(mixture, Scaling(0.0 * p, p, 0.0 * q, q, -100.0 * p, 100.0 * p))
    return unscaled.sample(np.repeat(point, draws, axis=0), np.random.default_rng(seed))


def test_samples_have_the_conditional_mixtures_mean_and_covariance(mixture, x):
    draws = 200_000
    point = x[:1]
    drawn = sampled(mixture, point, draws, seed=6)
    weights = direct_weights(mixture, np.vstack([point, point]))[0]
    means = mixture.component_means(point)[0]
    mean = weights @ means
    away = means - mean
    covariance = np.einsum("k,kij->ij", weights, mixture.conditional_covariances + away[:, :, None] * away[:, None, :])
    standard_error = np.sqrt(np.diag(covariance) / draws)
    assert (np.abs(drawn.mean(axis=0) - mean) < 5.0 * standard_error).all()
    np.testing.assert_allclose(np.cov(drawn.T), covariance, atol=0.03 * np.diag(covariance).max())


@pytest.mark.parametrize(
    ("weights", "mean", "variance", "message"),
    [
        ([1.0], np.nan, 1.0, "not finite"),
        ([0.7], 0.0, 1.0, "sum to one"),
        ([1.0], 0.0, -1.0, "positive definite"),
        ([1.0], 0.0, [[1.0, 0.0], [0.5, 1.0]], "symmetric"),
        ([0.5, 0.5], 0.0, 1.0, "do not fit"),
    ],
)
def test_what_is_no_mixture_is_refused_with_one_line(weights, mean, variance, message):
    with pytest.raises(InvalidMixtureError, match=message) as refusal:
        ConditionalGmm(np.array(weights), np.full((1, 2), mean), np.dot(variance, np.eye(2))[None], inputs=1)
    assert "\n" not in str(refusal.value)


def _as_sklearn(weights, means, covariances) -> GaussianMixture:
    model = GaussianMixture(len(weights), covariance_type="full")
    model.weights_, model.means_, model.covariances_ = weights, means, covariances
    model.precisions_cholesky_ = np.linalg.cholesky(np.linalg.inv(covariances))
    return model
