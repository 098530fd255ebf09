"""The outcome of a stress test in one sentence: which tracker is ahead, where and by how much."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harness.common.effects import Effect, paired_effect
from harness.scoring.metrics.quantity import Quantity

if TYPE_CHECKING:
    import pandas as pd

MOST_SETTINGS = 2
"""Of more settings the least and the largest lead are told."""


def leading_sentence(runs: pd.DataFrame, quantity: Quantity) -> str:
    """Return which tracker is ahead and by how much over the next one, with Student's 95 % intervals over seeds.

    Trackers are ranked by the mean of their settings' means; one is ahead if the interval over all excludes 0.

    Args:
        runs: A row for each run: ``tracker``, ``setting`` in words, ``seed`` and ``score``.
        quantity: What the score is.

    Returns:
        The sentence; empty with fewer than two trackers that have a score on the same traffic.
    """
    sign = 1.0 if quantity.higher_is_better else -1.0
    signed = runs.assign(score=sign * runs["score"])
    wide = signed.pivot_table(index=["setting", "seed"], columns="tracker", values="score", sort=False)
    ranked = wide.groupby("setting").mean().mean().sort_values(ascending=False, kind="stable").index
    pairs = wide[list(ranked[:2])].dropna()
    if len(ranked) < 2 or not len(pairs):
        return ""
    by_setting = {f"at {name}": _lead(of_setting) for name, of_setting in pairs.groupby("setting", sort=False)}
    overall = _lead(pairs)
    parts = {where: f"{_in_words(lead, quantity)} {where}" for where, lead in by_setting.items()}
    told = ", ".join(parts.values())
    if len(parts) > MOST_SETTINGS:
        least, *_, most = sorted(by_setting, key=lambda where: by_setting[where].difference)
        told = f"at the least {parts[least]}, at the most {parts[most]}"
    if len(parts) > 1:
        over_all = f"{_in_words(overall, quantity)} over {len(parts)} settings"
        told = f"{over_all}; {told}" if any(np.isfinite(lead.se) for lead in by_setting.values()) else over_all
    ahead = "is ahead of" if overall.ci95[0] > 0.0 else "is not clearly ahead of"
    return f"{ranked[0]} {ahead} {ranked[1]} in {quantity.label.rpartition(', ')[0]}: {told}."


def _lead(pairs: pd.DataFrame) -> Effect:
    """Return by how much the first column exceeds the second, as ``compare`` does; of a single seed over settings."""
    first, second = pairs.to_numpy(dtype=np.float64).T
    setting, seed = (pairs.index.get_level_values(name).factorize()[0] for name in ("setting", "seed"))
    return paired_effect(second, first, setting, seed if seed.any() else np.arange(len(pairs)))


def _in_words(lead: Effect, quantity: Quantity) -> str:
    sign = -1.0 if lead.difference < 0.0 else 1.0
    size, low, high = (f"{sign * value:.{quantity.decimals}f}" for value in (lead.difference, *lead.ci95[:: int(sign)]))
    interval = f"{low}, {high}" if np.isfinite(lead.se) else "one seed"
    unit = quantity.label.rpartition(", ")[2].replace("%", "percentage points")
    return f"{'behind by' if sign < 0.0 else 'by'} {size} {unit} [{interval}]"
