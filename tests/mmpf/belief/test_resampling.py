from dataclasses import replace

import numpy as np
import pytest

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.belief.resampling import resample, resample_smoothly
from mmpf.motion.state import ACCEL, LON, SPEED
from tests.mmpf.scenes import belief_of, spot


def mixture_of(weights: list[list[float]]) -> Mixture:
    shares = [np.maximum(np.asarray(own) / np.sum(own), 1e-300) for own in weights]
    mixture = belief_of([spot(0.0, 0.0, particles=len(own)) for own in weights], shares)
    cloud, number = mixture.cloud, np.arange(len(mixture.cloud))
    cloud.state[[LON, SPEED]] = number, 10.0 + number % 5
    return replace(mixture, cloud=replace(cloud, log_raw_weight=cloud.log_weight - 1.0))


def test_all_weight_on_one_particle_makes_every_sample_equal_to_it() -> None:
    resampled, ancestors = resample(
        mixture_of([[0, 0, 1, 0], [1, 0, 0, 0]]), np.array([True, True]), 8, np.random.default_rng(0)
    )
    assert ancestors.tolist() == [2] * 8 + [4] * 8
    assert np.exp(resampled.cloud.log_weight) == pytest.approx(np.full(16, 1 / 8))


def test_each_particle_is_copied_as_often_as_its_weight_says_up_to_one() -> None:
    weights = [0.5, 0.26, 0.14, 0.1]
    _, ancestors = resample(mixture_of([weights]), np.array([True]), 1000, np.random.default_rng(3))
    copies = np.bincount(ancestors, minlength=4)
    assert np.abs(copies - 1000 * np.array(weights)).max() <= 1.0


def test_resampling_is_unbiased() -> None:
    weights = np.array([0.5, 0.26, 0.14, 0.1])
    rng = np.random.default_rng(5)
    runs = 4000
    copies = np.zeros(4)
    for _ in range(runs):
        copies += np.bincount(resample(mixture_of([list(weights)]), np.array([True]), 4, rng)[1], minlength=4)
    assert copies / (4 * runs) == pytest.approx(weights, abs=0.01)


def test_components_that_are_not_chosen_keep_particles_and_weights() -> None:
    mixture = mixture_of([[1, 3], [2, 1, 1]])
    resampled, ancestors = resample(mixture, np.array([False, True]), 6, np.random.default_rng(0))
    assert ancestors[:2].tolist() == [0, 1]
    assert resampled.cloud.log_weight[:2] == pytest.approx(mixture.cloud.log_weight[:2])
    assert resampled.starts.tolist() == [0, 2, 8]


@pytest.mark.parametrize("width", [0.0, 0.4, 1.0])
def test_smoothing_keeps_mean_and_covariance_whatever_the_kernel(width: float) -> None:
    rng = np.random.default_rng(1)
    mixture = mixture_of([list(rng.uniform(size=4000)), list(rng.uniform(size=4000))])
    state, weight = mixture.cloud.state, np.exp(mixture.cloud.log_weight)
    state[ACCEL] = 0.3 * (state[SPEED] - 12.0) + rng.normal(size=8000)
    expected = np.cov(state[[LON, SPEED, ACCEL], :4000], aweights=weight[:4000], ddof=0)
    before = component_moments(mixture)
    smoothed = resample_smoothly(mixture, np.array([True, False]), 4000, np.full(2, width), np.random.default_rng(2))
    covariance = np.cov(smoothed.cloud.state[[LON, SPEED, ACCEL], :4000], ddof=0)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    assert covariance / scale == pytest.approx(expected / scale, abs=0.08)
    after = component_moments(smoothed)
    assert (np.abs(after.mean - before.mean)[:, 0] <= 1e-5 + 5.0 * before.std[:, 0] / np.sqrt(4000)).all()
    assert after.mean[:, 1] == pytest.approx(before.mean[:, 1])


def test_smoothed_particles_are_no_copies_and_never_reverse() -> None:
    mixture = mixture_of([[1.0] + [0.0] * 494 + [1.0] * 5])
    mixture.cloud.state[SPEED] *= 0.02
    smoothed = resample_smoothly(mixture, np.array([True]), 500, np.array([0.4]), np.random.default_rng(4))
    assert len(np.unique(smoothed.cloud.state[LON])) == 500
    assert (smoothed.cloud.state[SPEED] >= 0.0).all()


def test_what_latents_have_to_do_with_the_state_survives_smoothing() -> None:
    rng = np.random.default_rng(6)
    mixture = mixture_of([list(rng.uniform(size=4000))])
    habit = mixture.cloud.state[LON] / 1000.0 + rng.normal(size=4000)
    mixture = replace(mixture, cloud=replace(mixture.cloud, latents=habit[None]))
    expected = np.corrcoef(mixture.cloud.state[LON], habit)[0, 1]
    smoothed = resample_smoothly(mixture, np.array([True]), 4000, np.array([0.4]), rng)
    assert np.corrcoef(smoothed.cloud.state[LON], smoothed.cloud.latents[0])[0, 1] == pytest.approx(expected, rel=0.15)


def test_nothing_to_resample_leaves_the_belief_as_it_is() -> None:
    mixture = mixture_of([[1, 3], [2, 1]])
    assert resample_smoothly(mixture, np.zeros(2, dtype=bool), 6, np.ones(2), np.random.default_rng(0)) is mixture


def test_resampling_in_place_gives_each_particle_its_ancestors_rows_and_touches_no_other_component() -> None:
    mixture, copy = (mixture_of([[1, 3, 0, 2], [1, 1, 5, 0], [2, 1, 0, 4]]) for _ in range(2))
    which, rng = np.array([True, False, True]), np.random.default_rng(3)
    plain, ancestors = resample(copy, which, 4, np.random.default_rng(3))
    in_place = resample_smoothly(mixture, which, 4, np.zeros(3), rng)
    assert in_place.cloud.state[LON].tolist() == ancestors.tolist()
    for name in ("state", "log_weight", "log_raw_weight"):
        assert getattr(in_place.cloud, name) == pytest.approx(getattr(plain.cloud, name)), name


def test_a_component_of_another_size_is_not_resampled_in_place() -> None:
    with pytest.raises(ValueError, match="must have 5 particles"):
        resample_smoothly(mixture_of([[1, 3]]), np.array([True]), 5, np.ones(1), np.random.default_rng(0))
