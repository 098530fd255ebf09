"""Differences and their intervals: independent arithmetic, and the coverage that they claim."""

from __future__ import annotations

from dataclasses import dataclass

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


def test_a_seed_counts_once_however_many_densities_it_was_run_at():
    rng = np.random.default_rng(2)
    difference = rng.normal(1.0, 1.0, 8)
    density, seed = np.repeat([0, 1, 2], 8), np.tile(EACH, 3)
    thrice = paired_effect(np.zeros(24), np.tile(difference, 3), density, seed)
    once = paired_effect(np.zeros(8), difference, ONE, EACH)
    np.testing.assert_allclose(thrice.ci95, once.ci95)


def test_what_differs_between_densities_does_not_widen_the_interval():
    rng = np.random.default_rng(3)
    difference = rng.normal(1.0, 1.0, (2, 8))
    density, seed = np.repeat([0, 1], 8), np.tile(EACH, 2)
    near = paired_effect(np.zeros(16), difference.ravel(), density, seed)
    far = paired_effect(np.zeros(16), (difference + np.array([[0.0], [50.0]])).ravel(), density, seed)
    assert far.se == pytest.approx(near.se)


def test_arms_without_common_seeds_are_compared_by_welchs_test():
    rng = np.random.default_rng(4)
    a, b = rng.normal(10.0, 1.0, 8), rng.normal(11.0, 3.0, 5)
    effect = unpaired_effect(a, b, (ONE, ONE[:5]), (EACH, EACH[:5]))
    oracle = stats.ttest_ind(b, a, equal_var=False)
    assert effect.p == pytest.approx(oracle.pvalue)
    np.testing.assert_allclose(effect.ci95, oracle.confidence_interval(0.95))


def test_without_pairs_each_setting_is_compared_with_itself():
    # The arms differ by 1 at either density; comparing across densities would say -39.
    density = np.repeat([0, 1], 6)
    a, b = np.where(density == 0, 10.0, 90.0), np.where(density == 0, 11.0, 91.0)
    wobble = 0.01 * np.arange(12.0)
    effect = unpaired_effect(a + wobble, (b + wobble)[4:], (density, density[4:]), (np.arange(12), np.arange(4, 12)))
    assert effect.difference == pytest.approx(1.0, abs=0.05)
    assert effect.p < 0.01


def test_one_seed_tells_nothing_of_the_scatter():
    assert np.isnan(paired_effect(np.zeros(3), np.ones(3), np.arange(3), np.zeros(3, dtype=np.int64)).se)


def test_vehicles_that_never_meet_are_independent_and_those_always_together_are_one():
    influence = np.array([0.2, -0.1, 0.3, -0.4]) / 4.0
    alone = neighbours_effect(1.0, influence, np.eye(4))
    assert alone.units == 4.0
    assert alone.se == pytest.approx(np.sqrt((influence**2).sum()) * 4.0 / 3.0)
    assert np.isnan(neighbours_effect(1.0, influence, np.ones((4, 4))).se)


def test_the_units_that_would_decide_shrink_with_the_difference_and_grow_with_the_scatter():
    a, wobble = np.full(8, 100.0), 4.0 * np.array([-3.0, 2.0, 1.0, -1.0, 3.0, -2.0, 1.5, -1.5])
    small, large = (paired_effect(a, a + shift + wobble, ONE, EACH) for shift in (3.0, 6.0))
    needed = [effect.units_to_decide(2.0, 3, effect.difference) for effect in (small, large)]
    assert needed[0] is not None
    assert needed[1] is not None
    assert needed[0] > needed[1]
    assert paired_effect(a, a + 2.0 + wobble, ONE, EACH).units_to_decide(2.0, 3, 2.0) is None


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


@dataclass(frozen=True)
class Nested:
    """Runs whose metric is a mean over vehicle-steps of vehicles that nest in seeds, at two densities.

    Attributes:
        truth: The difference that b really makes.
    """

    truth: float = 0.14

    def draw(self, rng: np.random.Generator, seeds: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Draw both arms: seeds differ in how hard they are and in what b does to them, vehicles in both as well."""
        a, b, density, seed = [], [], [], []
        for number in range(seeds):
            hardness, shift = rng.lognormal(0.0, 0.2), rng.normal(self.truth, 0.12)
            for place in range(2):
                vehicles = rng.integers(15, 50)
                cost = hardness * rng.gamma(1.2, 3.3 * (1.0 + 0.3 * place), vehicles)
                steps = rng.geometric(1.0 / 60.0, vehicles)
                change = shift + 0.6 * np.sqrt(cost) * rng.standard_normal(vehicles)
                a.append(np.average(cost, weights=steps))
                b.append(a[-1] + np.average(change, weights=steps))
                density.append(place)
                seed.append(number)
        return np.array(a), np.array(b), np.array(density), np.array(seed)


@pytest.mark.parametrize("seeds", [3, 5, 10])
def test_intervals_over_seeds_cover_what_they_say(seeds):
    rng, nested = np.random.default_rng(seeds), Nested()
    intervals = [paired_effect(*nested.draw(rng, seeds)).ci95 for _ in range(600)]
    covered = np.mean([low <= nested.truth <= high for low, high in intervals])
    assert 0.93 <= covered <= 0.97


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
