import numpy as np
import pytest

from harness.running.watchers import systematic_sample
from mmpf.belief.mixture import ParticleCloud


def cloud_of(weights):
    """Return a cloud with the given weights of each component."""
    flat = np.concatenate([np.asarray(w, dtype=float) for w in weights]) if weights else np.zeros(0)
    component = np.repeat(np.arange(len(weights)), [len(w) for w in weights])
    with np.errstate(divide="ignore"):
        log_weight = np.log(flat)
    return ParticleCloud(
        state=np.zeros((6, len(flat))),
        log_weight=log_weight,
        log_raw_weight=log_weight,
        component=component,
        log_component_weight=np.zeros(len(flat)),
        latents=np.zeros((0, len(flat))),
    )


def test_a_particle_is_shown_as_often_as_it_weighs():
    sample = systematic_sample(cloud_of([[0.5, 0.25, 0.25], [0.0, 1.0]]), per_component=4)
    assert sample.tolist() == [0, 0, 1, 2, 4, 4, 4, 4]


def test_every_component_is_shown_alike_however_many_particles_it_has():
    rng = np.random.default_rng(3)
    weights = [w / w.sum() for w in (rng.random(n) for n in (1, 1000, 37))]
    cloud = cloud_of(weights)
    sample = systematic_sample(cloud, per_component=12)
    assert np.bincount(cloud.component[sample]).tolist() == [12, 12, 12]


def test_a_cloud_without_particles_has_no_sample():
    assert len(systematic_sample(cloud_of([]), per_component=12)) == 0


def test_weights_that_sum_to_slightly_less_than_one_stay_within_the_cloud():
    sample = systematic_sample(cloud_of([[0.5, 0.5 - 1e-3]]), per_component=1000)
    assert sample.max() == 1
    assert len(sample) == pytest.approx(1000)
