from __future__ import annotations

import numpy as np
import pytest

from harness.common.bootstrap import Interval, cluster_bootstrap, sums_by_label
from harness.common.intervals import ANY, possible_ci


def interval_of_mean(values, rng, groups, draws=1000) -> Interval:
    """Resample whole groups."""
    return cluster_bootstrap(*sums_by_label(values, groups), rng, draws=draws)[0]


def test_repeating_each_vehicles_error_a_hundred_times_does_not_narrow_the_interval():
    values = np.random.default_rng(0).normal(size=50)
    vehicle = np.arange(50)
    once = interval_of_mean(values, np.random.default_rng(1), vehicle)
    often = interval_of_mean(np.repeat(values, 100), np.random.default_rng(1), np.repeat(vehicle, 100))
    assert often.low == pytest.approx(once.low)
    assert often.high == pytest.approx(once.high)


def test_the_interval_covers_the_true_mean_about_as_often_as_it_says():
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(300):
        vehicle_mean = rng.normal(size=30)
        values = np.repeat(vehicle_mean, 10) + rng.normal(0, 0.1, 300)
        interval = interval_of_mean(values, rng, np.repeat(np.arange(30), 10), draws=300)
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
