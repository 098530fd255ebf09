from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmpf.compute.arrays import FloatArray
from mmpf.joint.association import associate

BIRTH = 0.3


def enumerated_probability(evidence: FloatArray, missed: FloatArray) -> FloatArray:
    """Exact association marginals: every way to give each component one detection or none, none shared."""
    components, detections = evidence.shape
    probability = np.zeros_like(evidence)
    total = 0.0
    for choice in product(range(-1, detections), repeat=components):
        used = [j for j in choice if j >= 0]
        if len(set(used)) < len(used):
            continue
        weight = (1.0 + BIRTH) ** (detections - len(used))
        for t, j in enumerate(choice):
            weight *= missed[t] if j < 0 else evidence[t, j]
        total += weight
        for t, j in enumerate(choice):
            if j >= 0:
                probability[t, j] += weight
    return probability / total


def test_two_components_and_two_detections_are_shared_out_as_by_enumeration() -> None:
    evidence = np.array([[30.0, 2.0], [1.5, 20.0]])
    missed = np.array([0.4, 0.5])
    assert associate(evidence, missed, BIRTH).probability == pytest.approx(
        enumerated_probability(evidence, missed), abs=0.02
    )


def test_belief_propagation_stays_close_to_enumeration() -> None:
    worst = []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        evidence = np.exp(rng.normal(-1.0, 2.0, (3, 3)))
        missed = rng.uniform(0.2, 1.0, 3)
        difference = associate(evidence, missed, BIRTH).probability - enumerated_probability(evidence, missed)
        worst.append(np.abs(difference).max())
    assert np.median(worst) < 0.01
    assert np.max(worst) < 0.25


@given(st.integers(0, 10_000), st.integers(0, 6), st.integers(0, 6))
@settings(deadline=None)
def test_no_component_and_no_detection_is_claimed_more_than_once(seed: int, components: int, detections: int) -> None:
    rng = np.random.default_rng(seed)
    evidence = np.exp(rng.normal(0.0, 4.0, (components, detections)))
    marginals = associate(evidence, rng.uniform(0.05, 1.0, components), BIRTH)
    assert (marginals.probability.sum(axis=1) <= 1.0 + 1e-9).all()
    assert ((marginals.unexplained > 0.0) & (marginals.unexplained <= 1.0)).all()


@given(st.integers(0, 10_000))
@settings(deadline=None)
def test_the_order_of_components_and_detections_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    evidence, missed = np.exp(rng.normal(0.0, 2.0, (4, 5))), rng.uniform(0.1, 1.0, 4)
    rows, columns = rng.permutation(4), rng.permutation(5)
    shuffled = associate(np.ascontiguousarray(evidence[rows][:, columns]), missed[rows], BIRTH)
    assert shuffled.probability == pytest.approx(associate(evidence, missed, BIRTH).probability[rows][:, columns])


def test_a_detection_between_two_components_is_shared_unless_sharing_is_allowed() -> None:
    evidence, missed = np.full((2, 1), 100.0), np.full(2, 0.5)
    exclusive = associate(evidence, missed, BIRTH, exclusive=True).probability
    shared = associate(evidence, missed, BIRTH, exclusive=False).probability
    assert exclusive.sum() <= 1.0 + 1e-9
    assert shared.sum() > 1.9
