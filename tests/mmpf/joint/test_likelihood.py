"""Likelihoods of detections against scipy's normal densities, and which pairs the gate lets through."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.joint.evidence import GatedLikelihoods, gated_likelihoods, resolvable_std
from mmpf.motion.state import LAT, LON, SPEED
from mmpf.numerics.arrays import FloatArray
from mmpf.scan import BodyHeadings, Detections
from tests.mmpf.scenes import belief_of, detections_at, spot


def spread_around(lon_m: float, lat_m: float, particles: int, seed: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    state = spot(lon_m, lat_m, 15.0, particles)
    state[[LON, LAT, SPEED]] += np.array([[1.5], [0.4], [3.0]]) * rng.standard_normal((3, particles))
    return state


def likelihoods_of(mixture: Mixture, detections: Detections, gate_std: float) -> GatedLikelihoods:
    return gated_likelihoods(mixture, component_moments(mixture), detections, gate_std)


def test_a_likelihood_is_a_normal_density_in_place_and_where_it_is_measured_in_speed() -> None:
    states = [spread_around(30.0, 5.0, 300, 1), spread_around(33.0, 9.0, 200, 2)]
    detections = replace(
        detections_at([(31.0, 5.5), (29.0, 8.0)], std_lon_m=0.7, std_lat_m=0.5),
        speed_mps=np.array([np.nan, 17.0]),
        std_speed_mps=np.array([np.nan, 1.2]),
    )
    found = likelihoods_of(belief_of(states), detections, np.inf)
    assert list(zip(found.component, found.detection, strict=True)) == [(0, 0), (0, 1), (1, 0), (1, 1)]
    for p, (m, j) in enumerate(zip(found.component, found.detection, strict=True)):
        state = states[m]
        expected = norm.pdf(detections.lon_m[j], state[LON], 0.7) * norm.pdf(detections.lat_m[j], state[LAT], 0.5)
        if j == 1:
            expected = expected * norm.pdf(17.0, state[SPEED], 1.2)
        assert found.values[found.starts[p] : found.starts[p + 1]] == pytest.approx(expected, rel=1e-9)


def test_correlated_noise_is_a_normal_density_of_both_places_together() -> None:
    states = [spread_around(30.0, 5.0, 300, 1), spread_around(33.0, 9.0, 200, 2)]
    uncorrelated = detections_at([(31.0, 5.5), (29.0, 8.0)], std_lon_m=0.7, std_lat_m=0.5)
    detections = replace(uncorrelated, correlation=np.array([0.8, -0.3]))
    found = likelihoods_of(belief_of(states), detections, np.inf)
    for p, (m, j) in enumerate(zip(found.component, found.detection, strict=True)):
        off = states[m][[LON, LAT]].T - [detections.lon_m[j], detections.lat_m[j]]
        expected = multivariate_normal.pdf(off, cov=detections.covariance_m2[j])
        assert found.values[found.starts[p] : found.starts[p + 1]] == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize(("std_lon_m", "std_lat_m"), [(0.7, 1e-3), (1e-3, 0.5)])
def test_a_floor_below_exact_noise_leaves_the_covariance_of_the_two_places(std_lon_m: float, std_lat_m: float) -> None:
    mixture = belief_of([spread_around(30.0, 5.0, 300, 1)])
    detections = replace(detections_at([(30.1, 5.0)], std_lon_m, std_lat_m), correlation=np.array([0.8]))
    spread = component_moments(mixture).std[[LON, LAT]]
    lon, lat = resolvable_std(np.array([[std_lon_m], [std_lat_m]]), spread, np.array([300]))[:, 0]
    covariance = 0.8 * std_lon_m * std_lat_m
    off = mixture.cloud.state[[LON, LAT]].T - [30.1, 5.0]
    expected = multivariate_normal.pdf(off, cov=[[lon**2, covariance], [covariance, lat**2]])
    assert likelihoods_of(mixture, detections, np.inf).values == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("axis", [LON, LAT])
@pytest.mark.parametrize(("share", "inside"), [(0.98, True), (-0.98, True), (1.02, False), (-1.02, False)])
def test_the_gate_is_as_wide_as_component_and_measurement_together_in_each_direction(
    axis: int, share: float, inside: bool
) -> None:
    state = spread_around(30.0, 5.0, 200, 3)
    deviation = np.hypot(state[axis].std(), (0.3, 0.2)[axis])
    place = [state[LON].mean(), state[LAT].mean()]
    place[axis] += share * 4.5 * deviation
    found = likelihoods_of(belief_of([state]), detections_at([(place[0], place[1])]), 4.5)
    assert len(found.component) == inside


@pytest.mark.parametrize("factor", [0.5, 2.5])
@pytest.mark.parametrize("axis", [LON, LAT])
def test_gate_and_likelihood_take_the_noise_that_the_component_has_learned(axis: int, factor: float) -> None:
    state = spread_around(30.0, 5.0, 200, 3)
    mixture = belief_of([state])
    mixture = replace(mixture, components=replace(mixture.components, noise_factor=np.array([factor])))
    std = np.array([0.5, 0.4])
    deviation = np.hypot(state[axis].std(), factor * std[int(axis == LAT)])
    for share in (0.98, 1.02):
        place = [state[LON].mean(), state[LAT].mean()]
        place[axis] += share * 4.5 * deviation
        detections = detections_at([(place[0], place[1])], std_lon_m=std[0], std_lat_m=std[1])
        found = likelihoods_of(mixture, detections, 4.5)
        assert len(found.component) == (share < 1.0)
        if share < 1.0:
            expected = norm.pdf(place[0], state[LON], factor * std[0]) * norm.pdf(place[1], state[LAT], factor * std[1])
            assert found.values == pytest.approx(expected, rel=1e-9)


def test_pairs_outside_of_the_gate_have_no_values_and_the_others_keep_their_order() -> None:
    mixture = belief_of([spot(0.0, 5.0, particles=3), spot(50.0, 5.0, particles=2)])
    found = likelihoods_of(mixture, detections_at([(50.0, 5.0), (0.1, 5.0), (25.0, 5.0)]), 4.5)
    assert found.component.tolist() == [0, 1]
    assert found.detection.tolist() == [1, 0]
    assert found.starts.tolist() == [0, 3, 5]


@pytest.mark.parametrize(("places", "detected"), [([], [(0.0, 0.0)]), ([(0.0, 0.0)], []), ([], [])])
def test_without_components_or_without_detections_there_are_no_pairs(
    places: list[tuple[float, float]], detected: list[tuple[float, float]]
) -> None:
    found = likelihoods_of(belief_of([spot(*place) for place in places]), detections_at(detected), 4.5)
    assert (len(found.component), len(found.values), found.starts.tolist()) == (0, 0, [0])


def test_a_measured_direction_weighs_each_particle_by_how_it_points_and_few_are_nothing_or_turned_round() -> None:
    rng = np.random.default_rng(5)
    states = [spread_around(30.0, 5.0, 300, 1), spread_around(33.0, 9.0, 200, 2)]
    heading = rng.uniform(-np.pi, np.pi, 500)
    mixture = belief_of(states)
    mixture = replace(mixture, cloud=replace(mixture.cloud, latents=heading[None]), has_headings=True)
    detections = detections_at([(31.0, 5.5), (29.0, 8.0)])
    measured, std, flipped = np.array([3.0, -0.4]), np.array([0.1, 0.3]), np.array([0.03, 0.2])
    plain = likelihoods_of(mixture, detections, np.inf)
    found = likelihoods_of(mixture, replace(detections, headings=BodyHeadings(measured, std, flipped)), np.inf)
    for p, (m, j) in enumerate(zip(found.component, found.detection, strict=True)):
        off = np.abs(np.angle(np.exp(1j * (np.split(heading, [300])[m] - measured[j]))))
        ahead, back = norm.pdf(off, 0.0, std[j]), norm.pdf(np.pi - off, 0.0, std[j])
        # Of directions one in twenty is any, with the density 1 / 2 pi.
        expected = 0.05 + 0.95 * 2.0 * np.pi * ((1.0 - flipped[j]) * ahead + flipped[j] * back)
        own = slice(found.starts[p], found.starts[p + 1])
        assert found.values[own] / plain.values[own] == pytest.approx(expected, rel=1e-9)
