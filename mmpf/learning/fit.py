"""Fitting Gaussian mixtures to samples: k-means start, expectation maximisation, choice of size by BIC."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mmpf.motion.conditional_gmm import ConditionalGmm
from mmpf.motion.scaled_gmm import ScaledGmm
from mmpf.road import FloatArray

REGULARISATION = 1e-6
ITERATIONS = 60
RANGE_QUANTILES = (0.0005, 0.9995)


@dataclass(frozen=True)
class SizeScore:
    """How well a mixture of one size does.

    Attributes:
        components: Number of components.
        bic: Bayesian information criterion over the samples it was fitted to; smaller is better.
        log_likelihood: Mean joint log-likelihood per sample.
    """

    components: int
    bic: float
    log_likelihood: float


def fit_mixture(x: FloatArray, y: FloatArray, components: int, seed: int, iterations: int = ITERATIONS) -> ScaledGmm:
    """Fit a joint mixture to inputs (n, p) and outputs (n, q); the start is k-means, equation (14) is maximised by EM.

    Args:
        x: Inputs, shape (n, p).
        y: Outputs, shape (n, q).
        components: Number of components.
        seed: Seed of the k-means start; the same samples and seed give the same mixture.
        iterations: Most EM iterations.
    """
    input_mean, input_scale = x.mean(axis=0), x.std(axis=0) + 1e-9
    output_mean, output_scale = y.mean(axis=0), y.std(axis=0) + 1e-9
    samples = np.hstack([(x - input_mean) / input_scale, (y - output_mean) / output_scale])
    weights, means, covariances = _expectation_maximisation(samples, components, seed, iterations)
    low, high = np.quantile(x, RANGE_QUANTILES, axis=0)
    mixture = ConditionalGmm(weights, means, covariances, x.shape[1])
    return ScaledGmm(mixture, input_mean, input_scale, output_mean, output_scale, low, high)


def sweep_sizes(
    x: FloatArray,
    y: FloatArray,
    sizes: Sequence[int],
    seed: int,
    progress: Callable[[str], None],
    iterations: int = ITERATIONS,
) -> list[SizeScore]:
    """Score mixtures of several sizes by BIC on the same samples."""
    samples = np.hstack([(x - x.mean(axis=0)) / (x.std(axis=0) + 1e-9), (y - y.mean(axis=0)) / (y.std(axis=0) + 1e-9)])
    scores = []
    for components in sizes:
        score = _score_size(samples, components, seed, iterations)
        progress(f"{components} components: BIC {score.bic:.0f}, log-likelihood {score.log_likelihood:.3f} a sample")
        scores.append(score)
    return scores


def _expectation_maximisation(
    samples: FloatArray, components: int, seed: int, iterations: int
) -> tuple[FloatArray, FloatArray, FloatArray]:
    fitted = _fitted(samples, components, seed, iterations)
    weights = fitted.weights_ / fitted.weights_.sum()
    return weights, fitted.means_, fitted.covariances_


def _score_size(samples: FloatArray, components: int, seed: int, iterations: int) -> SizeScore:
    fitted = _fitted(samples, components, seed, iterations)
    return SizeScore(components, float(fitted.bic(samples)), float(fitted.score(samples)))


def _fitted(samples: FloatArray, components: int, seed: int, iterations: int):  # type: ignore[no-untyped-def]  # noqa: ANN202
    import warnings  # noqa: PLC0415

    from sklearn.exceptions import ConvergenceWarning  # noqa: PLC0415
    from sklearn.mixture import GaussianMixture  # noqa: PLC0415

    model = GaussianMixture(
        components, covariance_type="full", reg_covar=REGULARISATION, max_iter=iterations, random_state=seed
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return model.fit(samples)
