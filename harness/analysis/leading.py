"""The outcome of a stress test in one sentence: which tracker is ahead, where and by how much."""

from collections.abc import Callable

import numpy as np
import pandas as pd

from harness.common.effects import Effect, paired_effect
from harness.scoring.metrics.quantity import Quantity

MOST_SETTINGS, FEWEST = 2, 3
"""Of more settings the least and the largest lead are told; nobody is ahead in fewer seeds."""


def leading_sentence(
    runs: pd.DataFrame, quantity: Quantity, decided: Callable[[str, str], bool | None] = lambda *_: None
) -> str:
    """Return which tracker is ahead of the next one, with Student's 95 % interval over seeds, and how much by setting.

    Trackers with a score at every setting are ranked by the mean of their settings' means over the runs that all have.

    Args:
        runs: A row for each run: ``tracker``, ``setting`` in words, ``unit`` (seed or recording) and ``score``.
        decided: Returns whether the verdict is that the first tracker is ahead of the second; None where there is no
            verdict on the two, so that the first is ahead if the interval excludes 0.

    Returns:
        The sentence; empty with fewer than two trackers that have a score on the same traffic.
    """
    sign = 1.0 if quantity.higher_is_better else -1.0
    signed = runs.assign(score=sign * runs["score"])
    wide = signed.pivot_table(index=["setting", "unit"], columns="tracker", values="score", sort=False)
    common = common_runs(wide)
    ranked = common.groupby("setting").mean().mean().sort_values(ascending=False, kind="stable").index
    if len(ranked) < 2 or not len(common):
        return ""
    pairs = wide[list(ranked[:2])].dropna()
    by_setting = {str(name): lead(each).difference for name, each in pairs.groupby("setting", sort=False)}
    overall = lead(pairs)
    shown = sorted(by_setting, key=by_setting.__getitem__) if len(by_setting) > MOST_SETTINGS else list(by_setting)
    parts = [f"{by_setting[name]:.{quantity.decimals}f} at {name}" for name in (shown[0], shown[-1])]
    between = "from {} to {}" if len(by_setting) > MOST_SETTINGS else "{}, {}"
    told = f" ({between.format(*parts)})" if len(by_setting) > 1 else f" at {shown[0]}"
    seeds = pairs.index.get_level_values("unit").nunique()
    verdict = decided(*ranked[:2])
    clear = overall.ci95[0] > 0.0 and seeds >= FEWEST if verdict is None else verdict
    lacking = ", ".join(wide.columns.difference(common.columns, sort=False))
    unranked = f" Not ranked, since a setting lacks its score: {lacking}." if lacking else ""
    claim = f"{'' if clear else 'it is undecided whether '}{ranked[0]} is ahead of {ranked[1]}"
    of = "seeds" if pd.api.types.is_numeric_dtype(runs["unit"]) else "recordings"
    size = _in_words(overall, quantity, seeds, of)
    return f"In {quantity.label.rpartition(', ')[0]}, {claim}: {size}{told}.{unranked}"


def common_runs(wide: pd.DataFrame) -> pd.DataFrame:
    """Return the runs that all trackers have, of trackers with a score at every setting, a column each."""
    return wide.loc[:, wide.notna().groupby("setting").any().all()].dropna()


def lead(pairs: pd.DataFrame) -> Effect:
    """Return by how much the first column exceeds the second, as ``compare`` does; rows are by setting and unit."""
    first, second = pairs.to_numpy(dtype=np.float64).T
    setting, unit = (pairs.index.get_level_values(name).factorize()[0] for name in ("setting", "unit"))
    return paired_effect(second, first, setting, unit)


def _in_words(lead: Effect, quantity: Quantity, seeds: int, of: str) -> str:
    size, low, high = (f"{value:.{quantity.decimals}f}" for value in (lead.difference, *lead.ci95))
    over = f" over {seeds} {of}" if seeds > 1 else ""
    interval = f"95 % interval {low} to {high}{over}" if np.isfinite(lead.se) else f"one {of[:-1]}"
    unit = quantity.label.rpartition(", ")[2].replace("%", "percentage points")
    return f"by {size} {unit}, {interval}"
