"""Fits Gaussian mixtures: k-means start, then expectation maximisation."""

import warnings

import numpy as np
from sklearn.exceptions import ConvergenceWarning
from sklearn.mixture import GaussianMixture

from mmpf.motion.gmm.conditional import ConditionalGmm
from mmpf.motion.gmm.kernel import Scaling
from mmpf.motion.gmm.scaled import ScaledGmm
from mmpf.numerics.arrays import FloatArray

REGULARISATION = 1e-6
ITERATIONS = 60
START_SAMPLES = 60_000
REFINING_ITERATIONS = 12
RANGE_QUANTILES = (0.0005, 0.9995)


def fit_mixture(x: FloatArray, y: FloatArray, components: int, seed: int) -> ScaledGmm:
    """Fit a joint mixture to inputs (n, p) and outputs (n, q); the start is k-means, equation (14) is maximised by EM.

    With more than 60 000 samples, EM first runs on that many of them and is then refined on all. The same samples and
    seed give the same mixture.
    """
    samples, scaling = _standardised(x, y)
    if len(samples) <= START_SAMPLES:
        fitted = _fitted(samples, components, seed, ITERATIONS)
    else:
        some = np.random.default_rng(seed).choice(len(samples), size=START_SAMPLES, replace=False)
        start = _fitted(samples[some], components, seed, ITERATIONS)
        fitted = _fitted(samples, components, seed, REFINING_ITERATIONS, start)
    weights = np.maximum(fitted.weights_, 1e-12)
    joint = ConditionalGmm(weights / weights.sum(), fitted.means_, fitted.covariances_, x.shape[1])
    return ScaledGmm(joint, scaling)


def _standardised(x: FloatArray, y: FloatArray) -> tuple[FloatArray, Scaling]:
    """Return inputs and outputs side by side, each of mean zero and variance one, and what undoes it."""
    input_mean, input_scale = x.mean(axis=0), x.std(axis=0) + 1e-9
    output_mean, output_scale = y.mean(axis=0), y.std(axis=0) + 1e-9
    samples = np.hstack([(x - input_mean) / input_scale, (y - output_mean) / output_scale])
    low, high = np.quantile(x, RANGE_QUANTILES, axis=0)
    return samples, Scaling(input_mean, input_scale, output_mean, output_scale, low, high)


def _fitted(
    samples: FloatArray, components: int, seed: int, iterations: int, start: GaussianMixture | None = None
) -> GaussianMixture:
    model = GaussianMixture(
        components, covariance_type="full", reg_covar=REGULARISATION, max_iter=iterations, random_state=seed
    )
    if start is not None:
        weights = start.weights_ / start.weights_.sum()
        model.set_params(weights_init=weights, means_init=start.means_, precisions_init=start.precisions_)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)
        return model.fit(samples)
