from __future__ import annotations

import numpy as np
import pytest

from mmpf.moments import component_moments
from mmpf.resampling import resample, resample_from_gaussian
from mmpf.state import LON, SPEED, Components, Mixture, ParticleCloud


def mixture_of(weights: list[list[float]]) -> Mixture:
    sizes = [len(w) for w in weights]
    flat = np.concatenate([np.asarray(w) / np.sum(w) for w in weights])
    state = np.zeros((6, len(flat)))
    state[LON] = np.arange(len(flat))
    state[SPEED] = 10.0 + np.arange(len(flat)) % 5
    component = np.repeat(np.arange(len(sizes)), sizes)
    log_weight = np.log(np.maximum(flat, 1e-300))
    cloud = ParticleCloud(state, log_weight, log_weight, component, np.zeros(len(flat)), np.zeros((0, len(flat))))
    return Mixture(cloud, Components.newborn(np.arange(1, len(sizes) + 1), np.full(len(sizes), 0.5)))


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


def test_the_gaussian_draw_keeps_the_mean_and_never_reverses() -> None:
    rng = np.random.default_rng(1)
    mixture = mixture_of([list(rng.uniform(size=4000)), list(rng.uniform(size=4000))])
    before = component_moments(mixture)
    after = component_moments(
        resample_from_gaussian(mixture, np.array([True, False]), before.effective_size, np.random.default_rng(2))
    )
    assert after.mean[LON, 0] == pytest.approx(before.mean[LON, 0], abs=5.0 * before.std[LON, 0] / np.sqrt(4000))
    assert after.mean[:, 1] == pytest.approx(before.mean[:, 1])
    assert after.std[LON, 0] >= before.std[LON, 0]
