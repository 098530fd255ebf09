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
CLEAR = 100.0
"""Likelihood ratio of a detection that hardly can be clutter."""
posteriors = arrays(np.float64, (1, *SHAPE), elements=st.floats(1e-3, 1.0)).map(normalised)
shares = st.floats(0.0, 1.0)


def sighting(claimed: float, in_shadow: float = IN_VIEW, run: float = 0.0) -> Sightings:
    every = (in_shadow, IN_VIEW, 1.0, claimed, float(claimed > 0.0), run)
    return Sightings(*(np.array([value]) for value in every))


def after_scans(kinds: FloatArray, hits: list[bool], in_shadow: float = IN_VIEW, run: float = 0.0) -> FloatArray:
    for hit in hits:
        kinds = normalised(weighed(kinds, sighting(CLEAR * hit, in_shadow, run)))
    return kinds


def log_odds(kinds: FloatArray) -> float:
    share = float(vehicle_share(kinds)[0])
    return float(np.log(share / (1.0 - share)))


def equal_prior() -> FloatArray:
    """As probably a vehicle as a false object, vehicles rather well and false objects rather badly detectable."""
    kinds = np.zeros((1, *SHAPE))
    kinds[:, VEHICLE] = 0.5 / len(SHADING) * shares_of(np.arange(1.0, 1.0 + LEVELS))
    kinds[:, FALSE] = 0.25 / len(SHADING) * shares_of(np.arange(1.0 + LEVELS, 1.0, -1.0))
    return kinds


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


@given(posteriors, st.lists(st.booleans(), max_size=60))
def test_however_often_a_source_is_detected_the_odds_move_no_further_than_the_two_kinds_profiles_differ(
    prior: FloatArray, hits: list[bool]
) -> None:
    """A mean of ratios lies between the least and the largest: nothing adds up from scan to scan."""
    by_level = prior[0].sum(axis=1)
    ratios = np.log(by_level[VEHICLE] / by_level[FALSE].sum(axis=0))
    assert ratios.min() - 1e-6 <= log_odds(after_scans(prior, hits)) <= ratios.max() + 1e-6


@pytest.mark.parametrize("rate", DETECTABILITY[:-1])
def test_who_is_detected_at_a_rate_for_long_has_the_odds_of_those_that_are_detected_at_that_rate(rate: float) -> None:
    prior = equal_prior()
    hits = (np.random.default_rng(0).random(3000) < IN_VIEW * rate).tolist()
    after = after_scans(prior, hits)
    level = int(np.flatnonzero(rate == DETECTABILITY)[0])
    assert mean_detectability(after) == pytest.approx([rate], abs=0.05)
    of_level = prior[0, :, :, level].sum(axis=1)
    assert log_odds(after) == pytest.approx(np.log(of_level[VEHICLE] / of_level[FALSE].sum()), abs=0.1)


@given(posteriors, st.lists(st.booleans(), max_size=20), st.floats(0.02, 0.95))
def test_scans_in_which_nothing_can_be_detected_say_nothing(
    prior: FloatArray, hits: list[bool], in_shadow: float
) -> None:
    assert after_scans(prior, hits, in_shadow, run=1.0) == pytest.approx(prior)


@given(st.integers(1, 30))
def test_misses_in_a_shadow_say_little_of_the_source_and_in_plain_view_they_say_much(misses: int) -> None:
    known = np.zeros((1, *SHAPE))
    known[:, VEHICLE, 0] = 0.5 / LEVELS
    known[:, FALSE, 0] = 0.25 * shares_of([1.0] + (LEVELS - 1) * [1e-9])
    in_view, in_shadow = (weighed(known, sighting(0.0, each)) for each in (IN_VIEW, 0.02))
    moved = [abs(log_odds(normalised(each)) - log_odds(known)) for each in (in_view, in_shadow)]
    assert moved[0] > 0.5
    assert moved[1] < 0.05
    longer = after_scans(known, [False] * misses, in_shadow=0.02)
    assert abs(log_odds(longer)) <= misses * 0.02


def test_one_detected_scan_after_scan_deep_in_a_shadow_is_seen_past_it() -> None:
    after = after_scans(equal_prior(), [True] * 20, in_shadow=0.02)
    assert after[:, :, SHADING == 0.0].sum() > 0.9


def test_one_missed_scan_after_scan_in_a_shadow_lies_in_it_or_can_hardly_be_detected() -> None:
    after = after_scans(equal_prior(), [False] * 40, in_shadow=0.02)
    seen_past = after[:, :, SHADING == 0.0, DETECTABILITY >= 0.5].sum()
    assert seen_past < 1e-3


def test_in_plain_view_nothing_is_learned_of_shadows() -> None:
    prior = equal_prior()
    after = after_scans(prior, [True, False, True, True])
    assert after.sum(axis=(1, 3)) == pytest.approx(prior.sum(axis=(1, 3)))


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
