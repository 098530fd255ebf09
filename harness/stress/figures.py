"""The curves of a grid as pictures: six panels over one axis."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from harness.stress.summary import BREAK_METRIC, BREAK_PERCENT, CURVES, Point, points_of

# Okabe and Ito's colours, which colour-blind readers can tell apart; after them the lines change their dashes.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
MOST_TICKS = 8
DASHES = ("-", "--", ":", "-.")
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
AXIS_LABELS = {"density": "density, vehicles per km and lane", "demand": "demand"}


def curves_figure(points: Sequence[Point], axis: str, title: str) -> Figure:
    """Return one panel a quantity, one line a tracker, with the 95 % band over seeds.

    Args:
        points: All points.
        axis: The axis to draw over.
        title: Heading.
    """
    figure = Figure(figsize=(12.0, 7.2), dpi=120, layout="constrained")
    panels = figure.subplots(2, 3, sharex=True)
    here = [point for point in points if point.axis == axis]
    lines = {}
    for axes, metric in zip(panels.flat, CURVES, strict=True):
        for place, (label, curve) in enumerate(points_of(here, axis, metric.name)):
            lines[label] = _draw(axes, curve, place)
        axes.set_ylim(bottom=0.0)
        if metric.label.endswith("%"):
            axes.set_ylim(0.0, 102.0)
        if metric.name == BREAK_METRIC and axis == "density":
            axes.axhline(BREAK_PERCENT, color="0.5", linewidth=0.8)
            axes.annotate("a tracker below this is broken", (0.02, BREAK_PERCENT - 2.0), va="top", color="0.4",
                          xycoords=("axes fraction", "data"), fontsize=8)  # fmt: skip
        if not any(point.metric == metric.name and point.mean is not None for point in here):
            axes.annotate("none", (0.5, 0.5), xycoords="axes fraction", ha="center", color="0.4")
        axes.set_title(metric.label, loc="left", fontsize=10)
        axes.spines[["top", "right"]].set_visible(False)
    values = sorted({point.value for point in here if not isinstance(point.value, str)})
    for axes in panels[-1]:
        if 1 < len(values) <= MOST_TICKS:
            axes.set_xticks(values)
        axes.set_xlabel(AXIS_LABELS.get(axis, axis))
    handles = [line for line in lines.values() if line is not None]
    figure.legend(handles=handles, loc="outside lower center", ncols=min(len(handles), 4) or 1, frameon=False)
    figure.suptitle(f"{title}: means and 95 % intervals over seeds", fontsize=11)
    return figure


def _draw(axes: Axes, curve: Sequence[Point], place: int) -> Line2D | None:
    if not curve:
        return None
    x = [point.value for point in curve]
    means, low, high = (np.array(column, dtype=np.float64) for column in zip(*map(_heights, curve), strict=True))
    colour = COLOURS[place % len(COLOURS)]
    (line,) = axes.plot(
        x,
        means,
        color=colour,
        linestyle=DASHES[place // len(COLOURS) % len(DASHES)],
        marker=MARKERS[place % len(MARKERS)],
        markersize=4,
        linewidth=1.8,
        label=curve[0].label,
    )
    if isinstance(x[0], str):
        axes.vlines(x, low, high, color=colour, linewidth=1.2)
    else:
        axes.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0)
    return line


def _heights(point: Point) -> tuple[float | None, float | None, float | None]:
    return (point.mean, *(point.ci95 or (None, None)))
