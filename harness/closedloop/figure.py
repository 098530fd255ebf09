"""The figure of a closed loop: what each belief did to the drive, with intervals over seeds."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure

from harness.closedloop.plan import BRAKE, CROSS
from harness.closedloop.summary import ALL, FREE_ONES, NEVER_SEEN, PROVOKED_ONES, SEEN_BEFORE, Score
from harness.common.plots import strip
from harness.scoring.metrics.closedloop import COLLIDED, HARD_BRAKES, QUANTITIES, TTC

LEAST_AXIS = 1.0
SPREAD = 0.66
SHOWN = (COLLIDED, TTC, HARD_BRAKES)
# Of Okabe and Ito's palette, told apart by their marks too.
STYLES = {
    ALL: ("#000000", "o"),
    FREE_ONES: ("#0072B2", "s"),
    PROVOKED_ONES: ("#D55E00", "^"),
    BRAKE: ("#CC79A7", "v"),
    CROSS: ("#E69F00", "P"),
    SEEN_BEFORE: ("#56B4E9", "<"),
    NEVER_SEEN: ("#F0E442", ">"),
}


def drives_figure(found: Sequence[Score], title: str) -> Figure:
    """Draw means with 95 % intervals of collisions, short times to collision and hard brakes, by belief."""
    rows = list(dict.fromkeys(score.belief for score in found))
    figure = Figure(figsize=(10.0, 1.6 + 0.45 * len(rows)), layout="constrained")
    panels = figure.subplots(1, len(SHOWN), sharey=True, squeeze=False)[0]
    kinds = list(dict.fromkeys(score.episodes for score in found))
    for panel, metric in zip(panels, SHOWN, strict=True):
        for place, kind in enumerate(kinds):
            colour, mark = STYLES[kind]
            own = [score for score in found if score.metric == metric and score.episodes == kind]
            known = [score for score in own if score.mean is not None]
            offset = SPREAD / max(len(kinds), 3) * (place - 0.5 * (len(kinds) - 1))
            at = [rows.index(score.belief) + offset for score in known]
            means = [score.mean or 0.0 for score in known]
            panel.scatter(means, at, color=colour, marker=mark, s=28, label=f"{kind} episodes", zorder=3)
            for score, height in zip(known, at, strict=True):
                if score.ci95 is not None:
                    panel.plot(score.ci95, (height, height), color=colour, linewidth=1.5)
        panel.set_xlabel(next(quantity.label for quantity in QUANTITIES if quantity.key == metric))
        panel.axvline(0.0, color="0.85", linewidth=0.8, zorder=0)
        # None of these is below zero, whatever an interval says; nor is a hundredth of a collision worth an axis.
        furthest = max(panel.get_xlim()[1], LEAST_AXIS)
        panel.set_xlim(-0.03 * furthest, furthest)
        strip(panel)
    panels[0].set_yticks(range(len(rows)), rows)
    panels[0].invert_yaxis()
    if found:
        figure.legend(
            *panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=len(kinds), frameon=False
        )
    figure.suptitle(f"{title}: means of the episodes with 95 % intervals", fontsize=11)
    return figure
