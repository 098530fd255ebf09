"""The figure of what went on inside the tracker: small panels over time."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.report.scene import BLUE, GREEN, ORANGE, VERMILION
from harness.writing.plots import mark_new_egos, stretch_s, strip
from mmpf.compute.arrays import FloatArray

FILE = "diagnostics.png"
EVENTS = {"births": BLUE, "deaths": VERMILION, "merges": GREEN, "reclusterings": ORANGE}


def diagnostics_figure(diagnostics: pd.DataFrame, title: str) -> Figure:
    """Return panels of components, effective sample size, events and association entropy over time.

    Args:
        diagnostics: The run's table of diagnostics, one row per step.
        title: Heading.
    """
    figure = Figure(figsize=(9.0, 8.0), dpi=120, layout="constrained")
    panels = figure.subplots(4, 1, sharex=True)
    _levels(panels[0], diagnostics, "components", "components", 1.0)
    _levels(panels[1], diagnostics, "effective_share", "effective sample\nsize, % of particles", 100.0)
    _events(panels[2], diagnostics)
    _levels(panels[3], diagnostics, "association_entropy", "association entropy,\nnats per component", 1.0)
    for axes in panels:
        axes.set_ylim(bottom=0.0)
        mark_new_egos(axes, diagnostics)
        strip(axes)
    longest_s = float(diagnostics["time_s"].max())
    panels[-1].set_xlim(float(diagnostics["time_s"].min()), 1.16 * longest_s + 0.1)
    panels[-1].set_xlabel("time, s")
    figure.align_ylabels(panels)
    width_s = stretch_s(longest_s - float(diagnostics["time_s"].min()))
    figure.suptitle(f"{title}: inside the tracker, each step (grey) and means over {width_s:g} s", fontsize=11)
    return figure


def _levels(axes: Axes, diagnostics: pd.DataFrame, column: str, label: str, scale: float) -> None:
    """Draw a quantity of every step thinly and its mean in each stretch of time boldly."""
    values = scale * diagnostics[column].to_numpy(dtype=np.float64)
    axes.plot(diagnostics["time_s"], values, color="0.75", linewidth=0.7)
    times, means = _over_stretches(diagnostics, values)
    axes.plot(times, means, color=BLUE, linewidth=1.8)
    axes.annotate(
        f"{means[-1]:.3g}", (times[-1], means[-1]), xytext=(6, 0), textcoords="offset points", color=BLUE, va="center"
    )
    axes.set_ylabel(label)


def _events(axes: Axes, diagnostics: pd.DataFrame) -> None:
    """Draw how many events of each kind a second brought, leaving out kinds that never came.

    An ego's first scan, which starts a component for every detection, would dwarf all that follows.
    """
    step_s = float(diagnostics["time_s"].diff().median()) if len(diagnostics) > 1 else 1.0
    later = diagnostics[diagnostics["episode"].duplicated()]
    ends = []
    for name, colour in EVENTS.items():
        count = later[name].to_numpy(dtype=np.float64)
        if not count.any():
            continue
        times, rates = _over_stretches(later, count / step_s)
        axes.plot(times, rates, color=colour, linewidth=1.6)
        ends.append((rates[-1], name, colour, times[-1]))
    _label_ends(axes, ends)
    axes.set_ylabel("events a second\nafter the first scan")


def _label_ends(axes: Axes, ends: list[tuple[float, str, str, float]]) -> None:
    top = axes.get_ylim()[1]
    height = -np.inf
    for value, name, colour, time_s in sorted(ends):
        height = max(value, height + 0.13 * top, 0.06 * top)
        axes.annotate(name, (time_s, height), xytext=(6, 0), textcoords="offset points", color=colour, va="center")


def _over_stretches(diagnostics: pd.DataFrame, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the middles of the stretches of time that have steps, and the mean of the values in each."""
    width_s = stretch_s(float(diagnostics["time_s"].max() - diagnostics["time_s"].min()))
    stretch = (diagnostics["time_s"].to_numpy(dtype=np.float64) / width_s + 1e-9).astype(np.int64)
    occupied = np.unique(stretch)
    reduced = np.array([values[stretch == index].mean() for index in occupied])
    return (occupied.astype(np.float64) + 0.5) * width_s, reduced
