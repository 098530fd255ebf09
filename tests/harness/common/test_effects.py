"""Differences and their intervals: independent arithmetic, and the coverage that they claim."""

import numpy as np
import pytest
from scipy import stats

from harness.analysis.vehicles import REACH_M
from harness.common.effects import neighbours_effect, paired_effect, unpaired_effect

ONE = np.zeros(8, dtype=np.int64)
EACH = np.arange(8)


def test_over_seeds_of_one_setting_it_is_the_paired_t_test():
    rng = np.random.default_rng(1)
    a, b = rng.normal(10.0, 2.0, (2, 8))
    effect = paired_effect(a, b, ONE, EACH)
    oracle = stats.ttest_rel(b, a)
    assert effect.p == pytest.approx(oracle.pvalue)
    np.testing.assert_allclose(effect.ci95, oracle.confidence_interval(0.95))


def test_arms_without_common_seeds_are_compared_by_welchs_test():
    rng = np.random.default_rng(4)
    a, b = rng.normal(10.0, 1.0, 8), rng.normal(11.0, 3.0, 5)
    effect = unpaired_effect(a, b, (ONE, ONE[:5]), (EACH, EACH[:5]))
    oracle = stats.ttest_ind(b, a, equal_var=False)
    assert effect.p == pytest.approx(oracle.pvalue)
    np.testing.assert_allclose(effect.ci95, oracle.confidence_interval(0.95))


def test_as_many_units_as_are_said_to_decide_do_so_in_about_four_cases_of_five():
    rng = np.random.default_rng(5)
    pilot = rng.standard_normal(6)
    pilot = (pilot - pilot.mean()) / pilot.std(ddof=1)
    effect = paired_effect(np.zeros(6), 0.9 + pilot, ONE[:6], EACH[:6])
    units = effect.units_to_decide(0.1, 1, 0.9)
    assert units is not None
    drawn = 0.9 + rng.standard_normal((400, units))
    zero, one, every = np.zeros(units), np.zeros(units, dtype=np.int64), np.arange(units)
    found = np.mean([paired_effect(zero, each, one, every).p < 0.05 for each in drawn])
    assert 0.72 < found < 0.9


@pytest.mark.parametrize(
    "seeds_of", [((0, 1, 2),) * 2, ((0,) * 3, (1,) * 3), ((0, 1), (2, 3), (4, 5)), (range(5), (0, 1))]
)
def test_intervals_cover_whether_or_not_every_seed_is_at_every_density(seeds_of):
    rng, seed = np.random.default_rng(6), np.concatenate(seeds_of)
    density = np.repeat(np.arange(len(seeds_of)), [len(some) for some in seeds_of])
    shifts = rng.standard_normal((1500, seed.max() + 1))[:, seed] + rng.standard_normal((1500, len(seed)))
    intervals = [paired_effect(0.0 * shift, shift, density, seed).ci95 for shift in shifts]
    assert 0.93 <= np.mean([low <= 0.0 <= high for low, high in intervals]) <= 0.97


@pytest.mark.parametrize(
    ("share_of_neighbours", "length_m", "road_m", "least"),
    [(0.0, 20.0, 1500.0, 0.93), (0.9, 20.0, 1500.0, 0.92), (0.7, 10.0, 800.0, 0.93)],
)
def test_intervals_over_vehicles_cover_though_neighbours_are_alike(share_of_neighbours, length_m, road_m, least):
    rng = np.random.default_rng(7)
    covered, trials, vehicles = 0, 600, 40
    for _ in range(trials):
        lon_m = rng.uniform(0.0, road_m, vehicles)
        apart = np.abs(lon_m[:, None] - lon_m)
        common = np.linalg.cholesky(np.exp(-apart / length_m) + 1e-9 * np.eye(vehicles)) @ rng.standard_normal(vehicles)
        own = rng.standard_normal(vehicles)
        difference = np.sqrt(share_of_neighbours) * common + np.sqrt(1.0 - share_of_neighbours) * own
        influence = (difference - difference.mean()) / vehicles
        effect = neighbours_effect(float(difference.mean()), influence, np.maximum(0.0, 1.0 - apart / REACH_M))
        low, high = effect.ci95
        covered += low <= 0.0 <= high
    assert least <= covered / trials <= 0.99
