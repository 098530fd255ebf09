"""The posterior over kinds of source, against Bayes' rule in plain loops over all cases."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mmpf.joint.kinds import (
    DETECTABILITY,
    FALSE,
    KINDS,
    LARGEST_PROBABILITY,
    LEVELS,
    SHADING,
    SHAPE,
    VEHICLE,
    Sightings,
    bounded,
    certain_vehicles,
    mean_detectability,
    normalised,
    relaxed_shading,
    shares_of,
    vehicle_share,
    weighed,
)
from mmpf.numerics.arrays import FloatArray

IN_VIEW = 0.95
posteriors = arrays(np.float64, (1, *SHAPE), elements=st.floats(1e-3, 1.0)).map(normalised)
shares = st.floats(0.0, 1.0)


def sighting(claimed: float, in_shadow: float = IN_VIEW, run: float = 0.0) -> Sightings:
    every = (in_shadow, IN_VIEW, 1.0, claimed, float(claimed > 0.0), run)
    return Sightings(*(np.array([value]) for value in every))


@given(posteriors, st.lists(st.tuples(st.floats(0.0, 50.0), st.floats(0.02, 0.95), shares), max_size=4))
def test_the_posterior_is_that_of_all_cases_enumerated(
    prior: FloatArray, scans: list[tuple[float, float, float]]
) -> None:
    expected = np.zeros(SHAPE)
    for kind, shading, level in product(range(KINDS), range(len(SHADING)), range(LEVELS)):
        weight = prior[0, kind, shading, level]
        for claimed, in_shadow, run in scans:
            hidden_by = (in_shadow / IN_VIEW) ** SHADING[shading]
            detected = min((1.0 - run) * IN_VIEW * hidden_by * DETECTABILITY[level], LARGEST_PROBABILITY)
            weight *= (1.0 - detected) + detected * claimed
        expected[kind, shading, level] = weight
    found = prior
    for claimed, in_shadow, run in scans:
        found = normalised(weighed(found, sighting(claimed, in_shadow, run)))
    assert found[0] == pytest.approx(expected / expected.sum(), abs=1e-9)
    assert found.sum() == pytest.approx(1.0)


@given(st.floats(0.0, 1.2), st.floats(0.0, 1.0), shares)
def test_detection_probabilities_grow_with_the_level_and_with_what_is_seen_past_shadows(
    in_shadow: float, in_view: float, run: float
) -> None:
    sightings = Sightings(*(np.array([value]) for value in (in_shadow, in_view, 1.0, 0.0, 0.0, run)))
    probability = sightings.detection_probabilities()
    assert probability.shape == (1, *SHAPE[1:])
    assert ((probability >= 0.0) & (probability <= LARGEST_PROBABILITY)).all()
    assert (np.diff(probability, axis=2) >= 0.0).all()
    assert (np.diff(probability, axis=1) >= -1e-12).all()


@given(posteriors, shares, shares)
def test_shadings_are_forgotten_among_vehicles_alone_and_steps_add_up(
    prior: FloatArray, first: float, second: float
) -> None:
    usual = shares_of([5.0, 3.0, 2.0])
    after = relaxed_shading(relaxed_shading(prior, usual, first), usual, second)
    assert after == pytest.approx(relaxed_shading(prior, usual, 1.0 - (1.0 - first) * (1.0 - second)))
    assert after[:, FALSE] == pytest.approx(prior[:, FALSE])
    assert after.sum(axis=2) == pytest.approx(prior.sum(axis=2))
    forgotten = relaxed_shading(prior, usual, 1.0)[0, VEHICLE]
    assert forgotten / forgotten.sum(axis=0) == pytest.approx(np.tile(usual[:, None], LEVELS))


@given(posteriors, st.floats(1e-6, 0.5))
def test_bounds_leave_both_kinds_possible_and_all_else_as_it_was(prior: FloatArray, least: float) -> None:
    after = bounded(prior, least)
    share = float(vehicle_share(prior)[0])
    assert after.sum() == pytest.approx(1.0)
    assert vehicle_share(after) == pytest.approx([min(max(share, least), 1.0 - least)])
    for kind in (slice(VEHICLE, VEHICLE + 1), FALSE):
        assert after[0, kind] / after[0, kind].sum() == pytest.approx(prior[0, kind] / prior[0, kind].sum())


def test_certain_vehicles_are_vehicles_of_full_detectability() -> None:
    kinds = certain_vehicles(3)
    assert kinds.shape == (3, *SHAPE)
    assert vehicle_share(kinds) == pytest.approx(np.ones(3))
    assert mean_detectability(kinds) == pytest.approx(np.ones(3))
