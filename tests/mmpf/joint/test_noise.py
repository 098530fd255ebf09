"""The noise of each component's detections is what its innovations say."""

from dataclasses import replace

import numpy as np
import pytest

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.joint.noise import FACTOR_BOUNDS, FOLLOWED_DRIFT, MEMORY_S, common_factor, no_more_exact, with_innovations
from mmpf.joint.sources import Sources
from mmpf.stages.update_rule import Situation
from tests.mmpf.scenes import belief_of, detections_at, spot
from tests.mmpf.test_update_rules import situation_with

STD_LON_M, STD_LAT_M = 0.3, 0.2


def situation_off_by(lon: float, lat: float, share: float = 0.0) -> Situation:
    """One detection of a vehicle at (30, 5), off by so many of its reported deviations."""
    situation = situation_with([])
    detections = detections_at([(30.0 + lon * STD_LON_M, 5.0 + lat * STD_LAT_M)], STD_LON_M, STD_LAT_M)
    sensor = replace(situation.sensor, noise_correlated_share=share)
    return replace(situation, scan=replace(situation.scan, detections=detections), sensor=sensor)


def one_vehicle() -> Mixture:
    return belief_of([spot(30.0, 5.0)])


def learned(innovations: list[tuple[float, float]], share: float = 0.0) -> Sources:
    mixture = one_vehicle()
    components, moments, first = mixture.components, component_moments(mixture), np.array([0])
    for lon, lat in innovations:
        components = with_innovations(components, moments, first, first, situation_off_by(lon, lat, share))
    return components


def test_one_detection_moves_the_noise_as_covariance_matching_with_a_memory_says() -> None:
    mixture = one_vehicle()
    components, moments, first = mixture.components, component_moments(mixture), np.array([0])
    share = 1.0 - np.exp(-situation_off_by(0, 0).dt_s / MEMORY_S)
    lon, lat, factor = 0.0, 0.0, 1.0
    for off_lon, off_lat in [(1.0, 2.0), (0.5, -1.5), (9.0, 0.0)]:
        std_lon, std_lat = factor * STD_LON_M, factor * STD_LAT_M
        terms = [
            (30.0 + off_lon * STD_LON_M - moments.mean[0, 0]) ** 2 / (moments.variance[0, 0] + std_lon**2),
            (5.0 + off_lat * STD_LAT_M - moments.mean[1, 0]) ** 2 / (moments.variance[1, 0] + std_lat**2),
        ]
        surprise = (min(terms[0], 9.0) + min(terms[1], 9.0)) / 2.0
        # The first detection is taken as it is, those after it are smoothed in.
        lon = std_lon if lon == 0.0 else (1.0 - share) * lon + share * std_lon
        lat = std_lat if lat == 0.0 else (1.0 - share) * lat + share * std_lat
        factor *= 1.0 + share * (surprise - 1.0) / 2.0
        situation = situation_off_by(off_lon, off_lat)
        components = with_innovations(components, moments, first, first, situation)
        found = (components.noise_factor[0], components.noise_lon_m[0], components.noise_lat_m[0])
        assert found == pytest.approx((factor, lon, lat))


@pytest.mark.parametrize(("times", "bound"), [(0.0, 0), (50.0, 1)])
def test_the_factor_stays_within_its_bounds(times: float, bound: int) -> None:
    assert learned([(times, times)] * 300).noise_factor == pytest.approx([FACTOR_BOUNDS[bound]])


def test_of_noise_that_drifts_innovations_show_only_what_the_filter_does_not_follow() -> None:
    shown = np.sqrt(1.0 - FOLLOWED_DRIFT * 0.5)
    assert learned([(shown, shown)] * 300, share=0.5).noise_factor == pytest.approx([1.0], rel=0.01)


def test_one_that_was_not_detected_learns_nothing() -> None:
    mixture, nobody = one_vehicle(), np.zeros(0, dtype=np.int64)
    after = with_innovations(mixture.components, component_moments(mixture), nobody, nobody, situation_off_by(0, 0))
    assert (after.noise_factor.tolist(), after.noise_lon_m.tolist()) == ([1.0], [0.0])


def test_a_new_component_begins_with_what_the_confirmed_ones_have_learned() -> None:
    columns = {"noise_factor": [1.0, 2.0, 3.0], "confirmed": [True, True, False]}
    assert common_factor(belief_of([spot(0.0, 5.0)] * 3, **columns).components) == pytest.approx(np.sqrt(2.5))
    assert common_factor(belief_of([]).components) == 1.0


def test_no_detection_is_taken_as_more_exact_than_the_smallest_deviation() -> None:
    scan = situation_with([(30.0, 5.0), (50.0, 5.0)]).scan
    exact = replace(scan, detections=replace(scan.detections, std_lon_m=np.array([1e-3, 0.3])))
    assert no_more_exact(exact).detections.std_lon_m == pytest.approx([0.04, 0.3])
    assert no_more_exact(exact).detections.std_lat_m == pytest.approx(scan.detections.std_lat_m)
    assert no_more_exact(scan) is scan
