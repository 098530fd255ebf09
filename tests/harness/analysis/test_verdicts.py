"""Verdicts: three words, what each needs, their false alarms and their power."""

import numpy as np
import pytest

from harness.analysis.arms import Arms, Layout, measure
from harness.analysis.rules import PRIMARY, Rules, compared_quantities
from harness.analysis.verdicts import BETTER, NO_WORSE, Verdict, holm, judge
from harness.scoring.metrics.quantity import Quantity


def arms(quantity: Quantity, a: np.ndarray, b: np.ndarray, label: str = "x") -> Arms:
    """Return paired arms of as many seeds as there are values."""
    one, each = np.zeros(len(a), dtype=np.int64), np.arange(len(a))
    return Arms(label, quantity, a, b, Layout(True, (one, one), (each, each)))


def judged(*given: Arms) -> list[Verdict]:
    return judge([measure(each) for each in given], Rules())


def test_holm_multiplies_by_the_number_of_tested_hypotheses_not_yet_rejected():
    # The example of Holm's procedure: 0.01 * 4, 0.02 * 3, 0.03 * 2, and never less than the one before.
    np.testing.assert_allclose(holm(np.array([0.03, 0.01, 0.9, 0.02])), [0.06, 0.04, 0.9, 0.06])
    np.testing.assert_allclose(holm(np.array([np.nan, 0.02, np.nan])), [np.nan, 0.02, np.nan])
    np.testing.assert_allclose(holm(np.array([0.7, 0.6])), [1.0, 1.0])


def simulated(rng: np.random.Generator, seeds: int, planted: float = 1.0, within: float = 0.04) -> list[Arms]:
    """Draw both arms of the metrics that are judged; seeds move all of them together, as dense or jammed traffic does.

    Args:
        rng: Source of all.
        seeds: Number of seeds.
        planted: Factor on b's hidden cost.
        within: How much a metric differs between two runs on the same detections though nothing changed, as a share.
    """
    found, hardness = [], rng.standard_normal(seeds)
    for quantity in compared_quantities():
        if quantity.key not in PRIMARY:
            continue
        a, b = (np.exp(0.15 * hardness + within / np.sqrt(2.0) * rng.standard_normal(seeds)) for _ in range(2))
        found.append(arms(quantity, a, b * (planted if quantity.key == "hidden.hidden_cost_m" else 1.0)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [3, 10])
def test_no_change_is_called_worse_in_at_most_five_percent_of_comparisons(seeds):
    rng = np.random.default_rng([7, seeds])
    worse = [any(verdict.regression for verdict in judged(*simulated(rng, seeds))) for _ in range(200)]
    assert np.mean(worse) <= 0.05


@pytest.mark.slow
@pytest.mark.parametrize("seeds", [3, 10])
def test_what_is_worse_by_the_tolerance_and_more_passes_as_no_worse_in_at_most_five_percent(seeds):
    rng = np.random.default_rng([8, seeds])
    passed = 0
    for _ in range(150):
        verdicts = judged(*simulated(rng, seeds, planted=1.021, within=0.01))
        passed += all(verdict.verdict in (NO_WORSE, BETTER) for verdict in verdicts)
    assert passed / 150 <= 0.05
