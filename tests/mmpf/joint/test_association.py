from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmpf.joint.association import associate
from mmpf.numerics.arrays import FloatArray

BIRTH = 0.3


def enumerated(evidence: FloatArray, missed: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Exact association marginals, and the probability that no component gave the detection, shape (d,).

    They go over every way to give each component one detection or none, none shared.
    """
    components, detections = evidence.shape
    probability = np.zeros_like(evidence)
    unexplained = np.zeros(detections)
    total = 0.0
    for choice in product(range(-1, detections), repeat=components):
        used = [j for j in choice if j >= 0]
        if len(set(used)) < len(used):
            continue
        weight = (1.0 + BIRTH) ** (detections - len(used))
        for t, j in enumerate(choice):
            weight *= missed[t] if j < 0 else evidence[t, j]
        total += weight
        unexplained[[j for j in range(detections) if j not in used]] += weight
        for t, j in enumerate(choice):
            if j >= 0:
                probability[t, j] += weight
    return probability / total, unexplained / total


def test_belief_propagation_stays_close_to_enumeration_on_graphs_with_loops() -> None:
    worst = []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        evidence, missed = np.exp(rng.normal(-1.0, 2.0, (3, 3))), rng.uniform(0.2, 1.0, 3)
        found, (probability, unexplained) = associate(evidence, missed, BIRTH), enumerated(evidence, missed)
        worst.append([np.abs(found.probability - probability).max(), np.abs(found.unexplained - unexplained).max()])
    assert (np.median(worst, axis=0) < 0.01).all()
    assert np.max(worst) < 0.25


@given(st.integers(0, 10_000), st.integers(0, 6), st.integers(0, 6))
@settings(deadline=None)
def test_no_component_and_no_detection_is_claimed_more_than_once(seed: int, components: int, detections: int) -> None:
    rng = np.random.default_rng(seed)
    evidence = np.exp(rng.normal(0.0, 4.0, (components, detections)))
    marginals = associate(evidence, rng.uniform(0.05, 1.0, components), BIRTH)
    assert (marginals.probability.sum(axis=1) <= 1.0 + 1e-9).all()
    assert ((marginals.unexplained > 0.0) & (marginals.unexplained <= 1.0)).all()


def assert_exact(evidence: FloatArray, missed: FloatArray, rel: float) -> None:
    marginals = associate(evidence, missed, BIRTH)
    for found, exact in zip((marginals.probability, marginals.unexplained), enumerated(evidence, missed), strict=True):
        assert found == pytest.approx(exact, rel=rel)


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (1, 6), (2, 1), (5, 1)])
@given(seed=st.integers(0, 10_000))
@settings(max_examples=20, deadline=None)
def test_one_component_or_one_detection_is_settled_exactly(shape: tuple[int, int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert_exact(np.exp(rng.normal(0.0, 3.0, shape)), rng.uniform(0.05, 1.0, shape[0]), 1e-9)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_a_row_of_vehicles_that_share_each_detection_with_the_next_is_settled_exactly(seed: int) -> None:
    """Each component reaches two detections, its own and the next one's: a chain, which has no loops."""
    rng = np.random.default_rng(seed)
    reached = np.eye(4) + np.eye(4, k=1)
    assert_exact(reached * np.exp(rng.normal(0.0, 2.0, (4, 4))), rng.uniform(0.05, 1.0, 4), 1e-6)


@given(seed=st.integers(0, 10_000), birth=st.floats(0.01, 2.0))
@settings(max_examples=30, deadline=None)
def test_without_exclusion_each_component_takes_the_detections_as_if_it_were_alone(seed: int, birth: float) -> None:
    rng = np.random.default_rng(seed)
    evidence, missed = np.exp(rng.normal(0.0, 2.0, (3, 4))), rng.uniform(0.05, 1.0, 3)
    together = associate(evidence, missed, birth, exclusive=False)
    for t in range(3):
        alone = associate(evidence[[t]], missed[[t]], birth)
        assert together.probability[t] == pytest.approx(alone.probability[0], rel=1e-9)
    by_all = (evidence / missed[:, None]).sum(axis=0)
    assert together.unexplained == pytest.approx((1.0 + birth) / (1.0 + birth + by_all))
