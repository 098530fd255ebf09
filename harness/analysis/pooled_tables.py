"""The pooled scores over recorded traffic as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple

import numpy as np
from matplotlib.figure import Figure

from harness.analysis.coasting_ratio import COASTING_TRACKER
from harness.analysis.pooled import HiddenError, Pooled, pooled_name, pooled_quantities
from harness.analysis.tables import COLOURS, value_cell
from harness.common.markdown import markdown_table
from harness.common.plots import label_ends

TITLE = "Recorded traffic"


def pooled_markdown(pooled: Pooled, failures: Sequence[str]) -> str:
    """Return all tables and what failed."""
    lines = [
        f"# {TITLE}",
        "",
        "Every vehicle that carries the sensor is an episode of its own; all trackers saw the same detections. Means "
        "over all samples of all files, with Student's 95 % intervals over files.",
        "",
        *_score_table(pooled),
        "",
        "## Hidden vehicles by the time since their last detection",
        "",
        "Mean absolute longitudinal error, m; in brackets that of coasting at constant velocity, told the true "
        "association, on the same vehicle-steps; then the ratio with its interval, the number of vehicle-steps and the "
        "share of all hidden ones that the tracker follows.",
        "",
        *_hidden_table(pooled),
        "",
        "![hidden](figures/hidden.png)",
        "",
        "## Files",
        "",
        *_file_table(pooled),
        "",
    ]
    if failures:
        lines += ["## Runs that failed", "", *(f"- {failure}" for failure in failures), ""]
    return "\n".join(lines)


def _score_table(pooled: Pooled) -> list[str]:
    found = {(mean.tracker, mean.quantity): mean for mean in pooled.means}
    columns = [column for column in pooled_quantities() if any(key == pooled_name(column) for _, key in found)]
    rows = [
        [label, str(switches), *(value_cell(found[label, pooled_name(column)], column.decimals) for column in columns)]
        for label, switches in pooled.id_switches.items()
    ]
    return markdown_table(["tracker", "identity switches", *(column.label for column in columns)], rows)


def _hidden_table(pooled: Pooled) -> list[str]:
    heads = list(dict.fromkeys(_time(error) for error in pooled.hidden))
    found = {(error.tracker, _time(error)): error for error in pooled.hidden}
    rows = [[label, *(_hidden_cell(found[label, head]) for head in heads)] for label in pooled.id_switches]
    return markdown_table(["tracker", *heads], rows)


def _file_table(pooled: Pooled) -> list[str]:
    rows = [list(map(str, astuple(count))) for count in pooled.files]
    total = ["all", *(str(sum(int(row[place]) for row in rows)) for place in range(1, 6))]
    heads = ["file", "vehicles read", "driven", "left out", "carried the sensor", "runs"]
    return markdown_table(heads, [*rows, total])


def _time(error: HiddenError) -> str:
    return "all" if error.to_s is None else f"{error.from_s:g} to {error.to_s:g} s"


def _hidden_cell(error: HiddenError) -> str:
    if error.lon_m is None or error.ratio is None:
        return "-"
    ends = f" [{error.ratio_ci95[0]:.2f}, {error.ratio_ci95[1]:.2f}]" if error.ratio_ci95 is not None else ""
    followed = f", {error.followed_percent:.0f} % followed" if error.followed_percent is not None else ""
    return f"{error.lon_m:.2f} ({error.coasting_lon_m:.2f}); {error.ratio:.2f}{ends}; {error.n}{followed}"


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
        f"Hidden vehicles in recorded traffic, 95 % intervals over files; {COASTING_TRACKER} coasts",
        loc="left",
        fontsize=10,
    )
    axes.spines[["top", "right"]].set_visible(False)
    return figure
