import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmpf.belief.moments import component_moments
from mmpf.motion.state import LON
from mmpf.options.paper import PaperReclustering
from mmpf.paper.clustering import k_medoids, recluster
from tests.mmpf.scenes import lane_centre
from tests.mmpf.test_update_rules import mixture_at


@given(st.integers(0, 1000))
@settings(max_examples=20, deadline=None)
def test_medoids_of_far_groups_are_one_point_of_each_group(seed: int) -> None:
    rng = np.random.default_rng(seed)
    centres = np.array([[0.0, 0.0], [50.0, 0.0], [0.0, 50.0]])
    points = np.concatenate([centre + rng.standard_normal((15, 2)) for centre in centres])
    medoids = k_medoids(points, centres + rng.uniform(-5.0, 5.0, centres.shape))
    for k, centre in enumerate(centres):
        assert np.hypot(*(medoids[k] - centre)) < 3.0
        assert (points == medoids[k]).all(axis=1).any()


def test_particles_that_strayed_to_a_neighbour_change_over_and_the_distribution_stays() -> None:
    mixture = mixture_at([(30.0, lane_centre(2)), (36.0, lane_centre(2))], std_m=0.4)
    mixture.cloud.state[LON, :50] += 6.0
    after, reclustered = recluster(mixture, component_moments(mixture), PaperReclustering(), np.random.default_rng(0))
    assert reclustered == 2
    assert np.bincount(after.cloud.component).tolist() == [350, 450]
    assert np.sort(after.cloud.state[LON]) == pytest.approx(np.sort(mixture.cloud.state[LON]))
    assert after.components.track_id.tolist() == mixture.components.track_id.tolist()


def test_components_that_do_not_touch_are_left_alone() -> None:
    mixture = mixture_at([(30.0, lane_centre(2)), (60.0, lane_centre(2))])
    after, reclustered = recluster(mixture, component_moments(mixture), PaperReclustering(), np.random.default_rng(0))
    assert reclustered == 0
    assert (after.cloud.component == mixture.cloud.component).all()
