from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from harness.common.bootstrap import Interval, cluster_bootstrap, sums_by_label
from harness.common.intervals import ANY, possible_ci


def interval_of_mean(values, rng, groups=None, draws=1000) -> Interval:
    """Resample whole groups, or the single values where there are none."""
    groups = np.arange(len(values)) if groups is None else groups
    return cluster_bootstrap(*sums_by_label(values, groups), rng, draws=draws)[0]


def test_the_interval_of_a_mean_has_the_width_that_theory_gives():
    values = np.random.default_rng(0).normal(5.0, 2.0, 400)
    interval = interval_of_mean(values, np.random.default_rng(1), draws=4000)
    half_width = 1.96 * values.std() / np.sqrt(400)
    assert interval.low == pytest.approx(values.mean() - half_width, abs=0.1 * half_width)
    assert interval.high == pytest.approx(values.mean() + half_width, abs=0.1 * half_width)


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


def test_one_group_gives_no_interval():
    interval = interval_of_mean(np.ones(10), np.random.default_rng(0), np.zeros(10, dtype=np.int64))
    assert np.isnan(interval.low)
    assert np.isnan(interval.high)


def test_values_that_are_missing_are_left_out():
    values = np.array([1.0, np.nan, 3.0, 2.0])
    with_gap = interval_of_mean(values, np.random.default_rng(0))
    without = interval_of_mean(values[[0, 2, 3]], np.random.default_rng(0))
    assert with_gap == without


def test_the_interval_over_few_groups_of_equal_size_is_that_of_the_t_distribution():
    values = np.random.default_rng(1).normal(5.0, 2.0, 4)
    interval = possible_ci(7.0 * values, np.full(4, 7.0), ANY)
    oracle = stats.ttest_1samp(values, 0.0).confidence_interval(0.95)
    assert (interval.low, interval.high) == pytest.approx((oracle.low, oracle.high))


@pytest.mark.parametrize("seeds", [3, 5, 10])
def test_intervals_over_few_seeds_cover_a_ratio_as_often_as_they_say(seeds):
    rng, covered = np.random.default_rng(seeds), 0
    for _ in range(1500):
        counts = rng.poisson(200.0, seeds).astype(np.float64)
        sums = counts * rng.normal(4.0, 0.6, seeds)
        interval = possible_ci(sums, counts, ANY)
        covered += interval.low <= 4.0 <= interval.high
    assert 0.93 <= covered / 1500 <= 0.97
