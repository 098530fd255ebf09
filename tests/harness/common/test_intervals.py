"""Intervals hold what can be, are never certain of what was not seen, and cover what they say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from harness.common.intervals import Possible, clopper_pearson, clustered_ci, garwood, possible_ci

SHARE, RATE, ERROR = Possible(0.0, 100.0), Possible(events=1.0), Possible()


@given(st.integers(0, 40), st.integers(1, 40))
def test_the_bounds_of_shares_are_those_of_the_binomial_distribution(hits, more):
    samples = hits + more
    found = clopper_pearson(hits / samples, samples)
    exact = stats.binomtest(hits, samples).proportion_ci(0.95, "exact")
    assert found == pytest.approx((exact.low, exact.high), abs=1e-9)


@given(st.integers(1, 200))
def test_the_bounds_of_rates_are_those_of_the_poisson_distribution(events):
    low, high = (events * end for end in garwood(events))
    assert stats.poisson.sf(events - 1, low) == pytest.approx(0.025, rel=1e-6)
    assert stats.poisson.cdf(events, high) == pytest.approx(0.025, rel=1e-6)


def test_no_collision_in_four_episodes_is_no_certainty():
    """Of four independent episodes the exact bound is 60 %; two of a seed are a little alike."""
    found = possible_ci(np.zeros(2), np.full(2, 2.0), SHARE)
    assert found.low == 0.0
    assert 60.2 < found.high < 63.0
    other = possible_ci(np.full(2, 200.0), np.full(2, 2.0), SHARE)
    assert (other.low, other.high) == pytest.approx((100.0 - found.high, 100.0))


def test_no_braking_in_half_a_kilometre_is_no_certainty_either():
    found = possible_ci(np.zeros(3), np.full(3, 0.15), RATE)
    assert found.low == 0.0
    assert found.high == pytest.approx(2.0 * stats.chi2.ppf(0.975, 2) / 2.0 / 0.45)


def test_a_cost_with_a_limit_has_students_interval_up_to_there():
    sums, counts = np.array([9.0, 10.0, 6.0]), np.ones(3)
    free, within = (possible_ci(sums, counts, each) for each in (ERROR, Possible(0.0, 10.0, is_share=False)))
    assert within.low == free.low < within.high == 10.0 < free.high


def test_one_cluster_and_values_that_all_agree_tell_no_scatter():
    for values in (np.array([3.0]), np.full(3, 3.0)):
        assert np.isnan(possible_ci(values, np.ones(len(values)), ERROR).low)


@pytest.mark.parametrize("seeds", [3, 5, 10])
@pytest.mark.parametrize("share", [0.02, 0.2, 0.8])
@pytest.mark.parametrize("alike", [0.0, 0.05])
def test_intervals_of_shares_cover_what_they_say(seeds, share, alike):
    """Outcomes of a seed are alike: beta-binomial with that intraclass correlation, 30 outcomes a seed."""
    rng = np.random.default_rng(7)
    trials, each = 1000, 30.0
    of_seed = np.full((trials, seeds), share)
    if alike:
        of_seed = rng.beta(share * (1.0 / alike - 1.0), (1.0 - share) * (1.0 / alike - 1.0), (trials, seeds))
    hits = 100.0 * rng.binomial(int(each), of_seed)
    found = [possible_ci(row, np.full(seeds, each), SHARE) for row in hits]
    assert np.mean([one.low <= 100.0 * share <= one.high for one in found]) >= 0.93


@pytest.mark.parametrize("seeds", [3, 5, 10])
@pytest.mark.parametrize("rate", [0.1, 1.0, 5.0])
@pytest.mark.parametrize("overdispersed", [1.0, 2.0])
def test_intervals_of_rates_cover_what_they_say(seeds, rate, overdispersed):
    """Events a seed are Poisson's, or negative binomial with twice its variance."""
    rng = np.random.default_rng(8)
    km = 3.0
    mean = np.full((1000, seeds), rate * km)
    if overdispersed > 1.0:
        mean = rng.gamma(mean / (overdispersed - 1.0), overdispersed - 1.0)
    found = [possible_ci(row, np.full(seeds, km), RATE) for row in rng.poisson(mean).astype(float)]
    assert np.mean([one.low <= rate <= one.high for one in found]) >= 0.93


def test_of_clusters_of_equal_size_the_interval_is_students_of_their_means():
    found = clustered_ci(np.array([9.0, 1.0, 7.0, 5.0, 3.0, 11.0]), np.array([7, 2, 4, 4, 2, 7]))
    half = 4.302653 * 4.0 / np.sqrt(3.0)  # Student's quantile of two degrees; the means are 2, 6 and 10
    assert (found.low, found.high) == pytest.approx((max(6.0 - half, 0.0), 6.0 + half))
