"""The charts of a closed loop: how each belief affects the drive, with intervals over seeds."""

from __future__ import annotations

from collections.abc import Sequence

from harness.closedloop.summary import Score
from harness.common.charts import Charts, curves, lines_of
from harness.scoring.metrics.closedloop import COLLIDED, HARD_BRAKES, QUANTITIES, TTC

SHOWN = (COLLIDED, TTC, HARD_BRAKES)


def drive_charts(found: Sequence[Score]) -> Charts:
    """Return means with 95 % intervals of collisions, short times to collision and hard brakes, by belief."""
    lines, charts = lines_of([f"{kind} episodes" for kind in dict.fromkeys(score.episodes for score in found)]), []
    for metric in SHOWN:
        title = next(quantity.label for quantity in QUANTITIES if quantity.key == metric)
        rows = []
        for score in found:
            if score.metric == metric and score.mean is not None:
                low, high = score.ci95 or (None, None)
                row = {"series": f"{score.episodes} episodes", "place": score.belief, "mean": score.mean}
                rows.append({**row, "low": None if low is None else max(low, 0.0), "high": high})
        if rows:
            tooltip = (("place", "driven by"), ("series", "episodes"), ("mean", title))
            charts.append(curves(title, f"{title}, by belief", "driven by", rows, lines, tooltip))
    return Charts(tuple(charts), lines, "Means of the episodes with 95 % intervals.")
