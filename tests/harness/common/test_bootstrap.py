import numpy as np
import pytest

from harness.common.bootstrap import cluster_bootstrap, group_sums
from harness.common.intervals import ANY, possible_ci


def test_the_interval_covers_the_true_mean_about_as_often_as_it_says():
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(300):
        vehicle_mean = rng.normal(size=30)
        values = np.repeat(vehicle_mean, 10) + rng.normal(0, 0.1, 300)
        interval = cluster_bootstrap(*group_sums(values[:, None], np.repeat(np.arange(30), 10)), rng, draws=300)[0]
        covered += interval.low <= 0.0 <= interval.high
    assert 0.89 < covered / 300 < 0.98


@pytest.mark.parametrize("seeds", [3, 5, 10])
def test_intervals_over_few_seeds_cover_a_ratio_as_often_as_they_say(seeds):
    rng, covered = np.random.default_rng(seeds), 0
    for _ in range(1500):
        counts = rng.poisson(200.0, seeds).astype(np.float64)
        sums = counts * rng.normal(4.0, 0.6, seeds)
        interval = possible_ci(sums, counts, ANY)
        covered += interval.low <= 4.0 <= interval.high
    assert 0.93 <= covered / 1500 <= 0.97
