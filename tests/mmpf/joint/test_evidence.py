"""The joint update's sums over particles, against plain double loops."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmpf.joint.evidence import GatedLikelihoods, association_evidence, log_normalised, normalised, particle_factors
from mmpf.numerics.arrays import FloatArray

SIZES = (3, 1, 40)
STARTS = np.concatenate([[0], np.cumsum(SIZES)])
DETECTIONS = 2


def random_case(seed: int) -> tuple[np.random.Generator, FloatArray, FloatArray, FloatArray]:
    """Weights, probabilities of detection, and f(z_j | x_n) of all pairs, zero outside of the gates."""
    rng = np.random.default_rng(seed)
    weight = rng.uniform(0.1, 1.0, STARTS[-1])
    component = np.repeat(np.arange(len(SIZES)), SIZES)
    weight /= np.bincount(component, weight)[component]
    inside = rng.uniform(size=(len(SIZES), DETECTIONS)) < 0.6
    density = rng.exponential(1.0, (STARTS[-1], DETECTIONS)) * inside[component]
    return rng, weight, rng.uniform(0.0, 1.0, STARTS[-1]), density


def gated(density: FloatArray) -> GatedLikelihoods:
    pairs = [
        (m, j) for m in range(len(SIZES)) for j in range(DETECTIONS) if density[STARTS[m] : STARTS[m + 1], j].any()
    ]
    values = [density[STARTS[m] : STARTS[m + 1], j] for m, j in pairs]
    component, detection = (np.array([pair[k] for pair in pairs], dtype=np.int64) for k in range(2))
    starts = np.concatenate([[0], np.cumsum([len(own) for own in values])]).astype(np.int64)
    return GatedLikelihoods(component, detection, np.concatenate([np.zeros(0), *values]), starts)


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_a_pairs_evidence_is_the_expected_likelihood_of_a_detection(seed: int) -> None:
    _, weight, detected, density = random_case(seed)
    evidence, not_seen = association_evidence(weight, STARTS, detected, gated(density), DETECTIONS)
    for m in range(len(SIZES)):
        own = range(STARTS[m], STARTS[m + 1])
        assert not_seen[m] == pytest.approx(sum(weight[n] * (1.0 - detected[n]) for n in own))
        for j in range(DETECTIONS):
            expected = sum(weight[n] * detected[n] * density[n, j] for n in own)
            assert evidence[m, j] == pytest.approx(expected, abs=1e-15)


@given(st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_a_particles_factor_is_what_a_miss_and_each_offered_detection_say_for_it(seed: int) -> None:
    rng, _, detected, density = random_case(seed)
    message = rng.uniform(0.0, 5.0, (len(SIZES), DETECTIONS))
    factor = particle_factors(detected, STARTS, gated(density), message)
    for m in range(len(SIZES)):
        for n in range(STARTS[m], STARTS[m + 1]):
            seen = sum(message[m, j] * density[n, j] for j in range(DETECTIONS))
            assert factor[n] == pytest.approx(1.0 - detected[n] + detected[n] * seen)


@pytest.mark.parametrize("offset", [0.0, -900.0, 700.0])
def test_weights_sum_to_one_in_each_component_however_small_or_large_they_were(offset: float) -> None:
    log_weight = np.random.default_rng(1).normal(offset, 3.0, STARTS[-1])
    weight, logarithm = normalised(log_weight, STARTS), log_normalised(log_weight, STARTS)
    for m in range(len(SIZES)):
        own = slice(STARTS[m], STARTS[m + 1])
        share = np.exp(log_weight[own] - log_weight[own].max())
        assert weight[own] == pytest.approx(share / share.sum())
        assert np.exp(logarithm[own]) == pytest.approx(share / share.sum())


def test_no_logarithm_of_a_weight_falls_below_that_of_the_smallest_number() -> None:
    assert log_normalised(np.array([0.0, -5000.0]), np.array([0, 2])) == pytest.approx([0.0, np.log(1e-300)])
