import numpy as np
import pytest

from mmpf.belief.birth import Traffic
from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.joint.rule import JointUpdate
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion.protocol import motion_models
from mmpf.motion.state import LAT, LON
from mmpf.options.filter import FilterOptions
from mmpf.paper.rule import MaxLikelihoodUpdate
from mmpf.scan import SensorModel
from mmpf.stages.update_rule import Occlusion, Situation, UpdateRule
from tests.mmpf.scenes import ROAD, belief_of, lane_centre, scan_of, spot

PARTICLES = 400


def options_with(settings: dict[str, object]) -> FilterOptions:
    return FilterOptions.model_validate({"particles": PARTICLES} | settings)


def mixture_at(places: list[tuple[float, float]], std_m: float = 1.0) -> Mixture:
    mixture = belief_of([spot(*place, 0.0, PARTICLES) for place in places])
    noise = np.random.default_rng(0).standard_normal((2, len(mixture.cloud)))
    mixture.cloud.state[[LON, LAT]] += np.array([[std_m], [0.3]]) * noise
    return mixture


def situation_with(detections: list[tuple[float, float]]) -> Situation:
    scan = scan_of(0.1, detections)
    traffic = Traffic(np.array([0.0]), np.array([20.0]))
    return Situation(scan, SensorModel(), motion_models["cvm"](), 0.1, traffic, SensorPlane(scan.ego, ROAD))


def weights_after(rule: UpdateRule, prior: Mixture, detections: list[tuple[float, float]]) -> Mixture:
    seen = Occlusion(np.full(len(prior.cloud), 0.9), *np.zeros((2, len(prior))))
    moments, situation = component_moments(prior), situation_with(detections)
    return rule.measurement_update(prior, moments, seen, situation, np.random.default_rng(0)).mixture


@pytest.mark.parametrize("distance_m", [8.0, 15.0, 60.0, 500.0])
@pytest.mark.parametrize(
    "rule",
    [
        JointUpdate(options_with({"joint": {"association": {"exclusion_per_s": 0.0}}}), SensorModel()),
        MaxLikelihoodUpdate(options_with({"max_likelihood": {"association": {"gate_std": 4.5}}}), SensorModel()),
    ],
    ids=["joint", "max_likelihood"],
)
def test_a_component_with_no_detection_in_its_gate_keeps_its_weights_at_any_distance(
    rule: UpdateRule, distance_m: float
) -> None:
    prior = mixture_at([(30.0, lane_centre(2))])
    posterior = weights_after(rule, prior, [(30.0 + distance_m, lane_centre(2))])
    assert posterior.cloud.log_weight == pytest.approx(prior.cloud.log_weight)


def test_the_rule_of_the_paper_lets_the_nearest_detection_win_however_far() -> None:
    rule = MaxLikelihoodUpdate(options_with({}), SensorModel())
    prior = mixture_at([(30.0, lane_centre(2))])
    posterior = weights_after(rule, prior, [(40.0, lane_centre(2))])
    mean = np.average(posterior.cloud.state[LON], weights=np.exp(posterior.cloud.log_weight))
    assert mean > 32.0


def test_component_weights_follow_equation_11() -> None:
    options = options_with({"max_likelihood": {"resampling": {"effective_share": 0.0}}})
    rule = MaxLikelihoodUpdate(options, SensorModel())
    prior = mixture_at([(30.0, lane_centre(2)), (60.0, lane_centre(1))], std_m=0.5)
    detections = [(30.2, lane_centre(2)), (61.0, lane_centre(1))]
    posterior = weights_after(rule, prior, detections)
    likelihood = np.zeros(len(prior.cloud))
    for lon, lat in detections:
        density = np.exp(
            -0.5 * ((prior.cloud.state[LON] - lon) / 0.3) ** 2 - 0.5 * ((prior.cloud.state[LAT] - lat) / 0.2) ** 2
        ) / (2 * np.pi * 0.3 * 0.2)
        likelihood = np.maximum(likelihood, density)
    raw_sums = np.bincount(prior.cloud.component, likelihood / PARTICLES)
    expected = 0.5 * raw_sums / (0.5 * raw_sums).sum()
    assert np.exp(posterior.cloud.log_component_weight[posterior.starts[:-1]]) == pytest.approx(expected)
