from dataclasses import fields

import numpy as np
import pytest

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments, effective_sizes, state_moments
from mmpf.motion.protocol import motion_models
from mmpf.motion.state import LON
from mmpf.options.filter import FilterOptions
from mmpf.scan import SensorModel
from mmpf.tracker import MixtureTracker
from tests.mmpf.scenes import ROAD, belief_of, ego_at, lane_centre, scan_of


def mixture_of(sizes: list[int]) -> Mixture:
    rng = np.random.default_rng(0)
    weights = [rng.uniform(0.1, 1.0, size) for size in sizes]
    states = [rng.normal(100.0, 5.0, (6, size)) for size in sizes]
    return belief_of(states, [weight / weight.sum() for weight in weights])


@pytest.mark.parametrize("sizes", [[1], [3, 1, 40], [7, 8, 9, 1000], []])
def test_moments_are_those_of_the_weighted_particles(sizes):
    mixture = mixture_of(sizes)
    found = component_moments(mixture)
    assert found.mean.shape == (6, len(sizes))
    for m in range(len(sizes)):
        own = mixture.cloud.component == m
        weight, state = np.exp(mixture.cloud.log_weight[own]), mixture.cloud.state[:, own]
        mean = np.average(state, axis=1, weights=weight)
        assert found.mean[:, m] == pytest.approx(mean, rel=1e-12)
        variance = np.average((state - mean[:, None]) ** 2, axis=1, weights=weight)
        assert found.variance[:, m] == pytest.approx(variance, rel=1e-9, abs=1e-18)
        assert effective_sizes(mixture)[m] == pytest.approx(1.0 / (weight**2).sum(), rel=1e-12)


def test_a_belief_written_to_has_the_moments_of_what_it_holds_now():
    mixture = mixture_of([50, 50])
    before = component_moments(mixture).mean.copy()
    mixture.cloud.state[LON] += 3.0
    assert component_moments(mixture).mean[LON] == pytest.approx(before[LON] + 3.0)


def test_the_moments_of_chosen_components_are_those_among_all():
    mixture, chosen = mixture_of([7, 8, 9, 1000]), np.array([3, 1])
    everyones, own = component_moments(mixture), state_moments(mixture, chosen, np.exp(mixture.cloud.log_weight))
    assert (own[0] == everyones.mean[:, chosen]).all()
    assert (own[1] == everyones.variance[:, chosen]).all()


@pytest.mark.parametrize("update", ["joint", "max_likelihood"])
def test_a_step_leaves_nothing_with_the_belief_but_what_it_declares(update):
    tracker = MixtureTracker(
        ROAD,
        SensorModel(),
        motion_models["cvm"](),
        np.random.default_rng(0),
        FilterOptions.model_validate({"update": update, "particles": 50}),
    )
    for step in range(5):
        tracker.step(scan_of(0.1 * step, [(20.0 + 2.0 * step, lane_centre(1))], ego_at(lon_m=2.0 * step)))
    for part in (tracker.mixture, tracker.mixture.cloud, tracker.mixture.components):
        assert set(vars(part)) == {field.name for field in fields(part)}
