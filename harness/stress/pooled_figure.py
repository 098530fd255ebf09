"""The picture of recorded traffic: how far off each tracker is for hidden vehicles, by the time hidden."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from harness.stress.coasting import COASTING
from harness.stress.figures import COLOURS
from harness.stress.pooled import Pooled
from harness.study.figures import label_ends

OFFSET_S = 0.06


def hidden_figure(pooled: Pooled) -> Figure:
    """Draw each tracker's mean hidden error over the bins' middles, with 95 % intervals over files."""
    figure = Figure(figsize=(7.6, 4.4), dpi=120, layout="constrained")
    axes = figure.subplots()
    labels = list(pooled.id_switches)
    ends = []
    for place, label in enumerate(labels):
        shown = [error for error in pooled.hidden if error.tracker == label and error.to_s is not None and error.n]
        if not shown:
            continue
        colour = COLOURS[place % len(COLOURS)]
        shift = OFFSET_S * (place - 0.5 * (len(labels) - 1))
        time_s = [0.5 * (error.from_s + (error.to_s or 0.0)) + shift for error in shown]
        means = np.array([error.lon_m for error in shown], dtype=np.float64)
        for time, error in zip(time_s, shown, strict=True):
            if error.lon_m_ci95 is not None:
                axes.vlines(time, *error.lon_m_ci95, color=colour, linewidth=1.2, alpha=0.7)
        axes.plot(time_s, means, "o-", color=colour, markersize=4, linewidth=1.8)
        ends.append((shown[-1].from_s, time_s[-1], float(means[-1]), label, colour))
    axes.set_ylim(bottom=0.0)
    axes.set_xlim(left=0.0)
    for from_s in {end[0] for end in ends}:
        here = [end for end in ends if end[0] == from_s]
        label_ends(axes, [(mean, label, colour) for _, _, mean, label, colour in here], max(end[1] for end in here))
    axes.set_xlabel("time since the last detection, s")
    axes.set_ylabel("MAE of longitudinal position while followed, m")
    axes.set_title(
        f"Hidden vehicles in recorded traffic, 95 % intervals over files; {COASTING} coasts", loc="left", fontsize=10
    )
    axes.spines[["top", "right"]].set_visible(False)
    return figure
