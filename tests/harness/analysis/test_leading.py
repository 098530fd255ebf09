"""Who is ahead in a stress test, against paired tests of SciPy."""

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from harness.analysis.leading import leading_sentence
from harness.scoring.metrics.quantity import Quantity

HOTA = Quantity("mot.hota", "HOTA in sight, %", higher_is_better=True)
COST = Quantity("hidden.hidden_cost_m", "hidden cost, m", decimals=2)


def runs_of(means, seeds=6):
    """Return runs whose scores scatter around the mean of each tracker and setting, on traffic that all share."""
    rng = np.random.default_rng(3)
    shared = rng.normal(0.0, 5.0, seeds)
    rows = [
        {"tracker": tracker, "setting": setting, "unit": seed, "score": mean + shared[seed] + rng.normal()}
        for (tracker, setting), mean in means.items()
        for seed in range(seeds)
    ]
    return pd.DataFrame(rows).sample(frac=1.0, random_state=0).sort_values("setting", kind="stable")


def lead_of(runs, setting, ahead, behind):
    # Settings of one seed share their traffic, so that a seed counts once.
    here = runs[runs["setting"].isin(setting)].pivot_table(index="unit", columns="tracker", values="score")
    test = stats.ttest_rel(here[ahead], here[behind])
    return (here[ahead] - here[behind]).mean(), *test.confidence_interval(0.95)


def test_the_two_best_of_those_with_every_setting_are_compared_pair_by_pair():
    runs = runs_of({("a", "20"): 80.0, ("a", "45"): 70.0, ("b", "20"): 85.0, ("b", "45"): 78.0, ("c", "20"): 95.0})
    mean, low, high = lead_of(runs, ("20", "45"), "b", "a")
    parts = ", ".join(f"{lead_of(runs, (setting,), 'b', 'a')[0]:.1f} at {setting}" for setting in ("20", "45"))
    lead = f"by {mean:.1f} percentage points, 95 % interval {low:.1f} to {high:.1f} over 6 seeds ({parts})"
    assert leading_sentence(runs, HOTA) == (
        f"In HOTA in sight, b is ahead of a: {lead}. Not ranked, since a setting lacks its score: c."
    )
    assert leading_sentence(runs[runs["tracker"] == "b"], HOTA) == ""


def test_of_a_cost_the_lower_one_leads_and_a_lost_setting_is_told_and_counts():
    runs = runs_of({(name, where): cost for name, costs in {"a": (2.0, 9.0, 9.5), "b": (7.0, 5.0, 5.0)}.items()
                    for where, cost in zip("123", costs, strict=True)})  # fmt: skip
    told = leading_sentence(runs, COST)
    lost, most = (lead_of(runs, (setting,), "a", "b")[0] for setting in ("1", "3"))
    assert lead_of(runs, ("2",), "a", "b")[1] > 0.0 > lead_of(runs, ("1", "2", "3"), "a", "b")[1]
    assert told.startswith("In hidden cost, it is undecided whether b is ahead of a: by ")
    assert told.endswith(f" (from {lost:.2f} at 1 to {most:.2f} at 3).")


@pytest.mark.parametrize(("seeds", "lead"), [(1, 0.0), (5, 0.0), (2, 900.0)])
def test_a_lead_that_chance_may_explain_or_of_few_seeds_is_not_claimed(seeds, lead):
    told = leading_sentence(runs_of({("a", "20"): 80.0, ("b", "20"): 80.0 + lead}, seeds), HOTA)
    assert "it is undecided whether" in told
    assert ("one seed" in told) == (seeds == 1)


def test_recordings_are_the_units_where_several_seeds_ran_on_each():
    runs = runs_of({("a", "x"): 80.0, ("b", "x"): 90.0}).assign(unit=lambda rows: "r" + (rows["unit"] % 3).astype(str))
    assert "over 3 recordings" in leading_sentence(runs, HOTA)
