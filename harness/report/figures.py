"""The figures of one run: a telling moment, the error over time and by visibility, what went on in the tracker."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.common.palette import BLUE, GREEN, ORANGE, VERMILION
from harness.common.plots import mark_new_egos, stretch_s, strip
from harness.report.scene import Scene, scene_figure
from harness.running.run import Pictured
from mmpf.numerics.arrays import FloatArray, IntArray

COLOURS = {"visible": GREEN, "partial": ORANGE, "hidden": VERMILION}
NAMES = {"visible": "visible", "partial": "partly hidden", "hidden": "hidden"}
ERROR_COLUMNS = (
    ("lon_error_m", "lon_m", "longitudinal position, m"),
    ("lat_error_m", "lat_m", "lateral position, m"),
    ("speed_error_mps", "speed_mps", "speed, m/s"),
)
SCENE, OVER_TIME, BY_VISIBILITY = "scene.png", "error_over_time.png", "error_by_visibility.png"
DIAGNOSTICS = "diagnostics.png"
EVENTS = {"births": BLUE, "deaths": VERMILION, "merges": GREEN, "reclusterings": ORANGE}
FEWEST_SAMPLES = 5

End = tuple[float, str, str, float]
"""Where a line ends: height, name, colour and time."""


def draw_figures(folder: Path, pictured: Pictured) -> None:
    """Draw all figures of a run into a new folder."""
    folder.mkdir()
    title, moment = pictured.title, pictured.moment
    if moment is not None:
        look = moment.look
        scene = Scene(
            look.frame, look.observation, moment.tracks, pictured.road, pictured.sensor.range_m, moment.particles
        )
        scene_figure(scene, f"{title}: {look.frame.time_s:.1f} s").savefig(folder / SCENE)
    error_over_time(pictured.errors, title).savefig(folder / OVER_TIME)
    error_by_visibility(pictured.metrics["mae"], title).savefig(folder / BY_VISIBILITY)
    if pictured.diagnostics is not None:
        diagnostics_figure(pictured.diagnostics, title).savefig(folder / DIAGNOSTICS)


def error_over_time(errors: pd.DataFrame, title: str) -> Figure:
    """Return the mean absolute error in each stretch of time, one panel a quantity, one line a visibility.

    Rows of vehicles that no track follows are left out.
    """
    tracked = errors[errors["outcome"] == "tracked"]
    width_s = stretch_s(float(errors["time_s"].max()) if len(errors) else 1.0)
    figure = Figure(figsize=(9.0, 7.0), dpi=120, layout="constrained")
    panels = figure.subplots(len(ERROR_COLUMNS), 1, sharex=True)
    for axes, (column, _, label) in zip(panels, ERROR_COLUMNS, strict=True):
        ends: list[End] = []
        for state, colour in COLOURS.items():
            times, means, _ = means_over_time(tracked[tracked["state"] == state], column, width_s)
            axes.plot(times, means, color=colour, linewidth=1.8, marker="o", markersize=3)
            if np.isfinite(means).any():
                last = np.flatnonzero(np.isfinite(means))[-1]
                ends.append((means[last], NAMES[state], colour, times[last]))
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel(label)
        _label_ends(axes, ends, apart=0.11, lowest=0.05)
        mark_new_egos(axes, errors)
        strip(axes)
    longest_s = width_s * np.ceil(float(tracked["time_s"].max()) / width_s + 1e-9) if len(tracked) else 1.0
    panels[-1].set_xlim(0.0, 1.16 * longest_s)
    panels[-1].set_xlabel("time, s")
    figure.suptitle(f"{title}\nmean absolute error in stretches of {width_s:g} s", fontsize=11)
    return figure


def error_by_visibility(mae: Mapping[str, Any], title: str) -> Figure:
    """Return bars of the mean absolute errors of ``metrics.json`` with their 95 % intervals, one panel a quantity."""
    figure = Figure(figsize=(10.5, 3.8), dpi=120, layout="constrained")
    panels = figure.subplots(1, len(ERROR_COLUMNS))
    for axes, (_, key, label) in zip(panels, ERROR_COLUMNS, strict=True):
        highest = 0.0
        for place, state in enumerate(COLOURS):
            highest = max(highest, _bar(axes, place, state, mae[state], key))
        axes.set_xticks(range(len(COLOURS)), [_tick(state, mae[state]) for state in COLOURS], fontsize=8)
        axes.tick_params(axis="x", length=0)
        axes.set_ylim(0.0, 1.15 * highest or 1.0)
        axes.set_ylabel(label)
        strip(axes)
    figure.suptitle(f"{title}\nmean absolute error while followed, 95 % intervals over vehicles", fontsize=11)
    return figure


def _tick(state: str, row: Mapping[str, Any]) -> str:
    share = row.get("followed_percent")
    followed = f"\n{share:.0f} % followed" if share is not None else ""
    return f"{NAMES[state]}\nn = {row['n'] or 0}{followed}"


def _bar(axes: Axes, place: int, state: str, row: Mapping[str, Any], key: str) -> float:
    """Draw one bar with its interval and figure, and return how high it all reaches."""
    mean, interval = row[key], row.get(f"{key}_ci95")
    if mean is None:
        axes.annotate("none", (place, 0.0), ha="center", va="bottom", color="0.4")
        return 0.0
    low, high = interval if interval is not None else (mean, mean)
    axes.bar(place, mean, width=0.6, color=COLOURS[state])
    axes.vlines(place, low, high, color="black", linewidth=1.2)
    axes.annotate(f"{mean:.2f}", (place, high), xytext=(0, 3), textcoords="offset points", ha="center", va="bottom")
    return float(high)


def means_over_time(rows: pd.DataFrame, column: str, width_s: float) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the middle of each stretch of time, the mean absolute value in it, nan with too few samples, and these."""
    if not len(rows):
        return np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.int64)
    stretch = (rows["time_s"].to_numpy(dtype=np.float64) / width_s + 1e-9).astype(np.int64)
    count = np.bincount(stretch)
    total = np.bincount(stretch, weights=np.abs(rows[column].to_numpy(dtype=np.float64)))
    means = np.where(count >= FEWEST_SAMPLES, total / np.maximum(count, 1), np.nan)
    return (np.arange(len(count), dtype=np.float64) + 0.5) * width_s, means.astype(np.float64), count


def diagnostics_figure(diagnostics: pd.DataFrame, title: str) -> Figure:
    """Return panels of components, effective sample size, events and association entropy over time."""
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
    figure.suptitle(f"{title}\ninside the tracker, each step (grey) and means over {width_s:g} s", fontsize=11)
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
    ends: list[End] = []
    for name, colour in EVENTS.items():
        count = later[name].to_numpy(dtype=np.float64)
        if not count.any():
            continue
        times, rates = _over_stretches(later, count / step_s)
        axes.plot(times, rates, color=colour, linewidth=1.6)
        ends.append((rates[-1], name, colour, times[-1]))
    _label_ends(axes, ends, apart=0.13, lowest=0.06)
    axes.set_ylabel("events a second\nafter the first scan")


def _label_ends(axes: Axes, ends: list[End], apart: float, lowest: float) -> None:
    """Write each line's name at its end, moved apart where they would overlap, in shares of the panel's height."""
    top = axes.get_ylim()[1]
    height = -np.inf
    for value, name, colour, time_s in sorted(ends):
        height = max(value, height + apart * top, lowest * top)
        axes.annotate(name, (time_s, height), xytext=(6, 0), textcoords="offset points", color=colour, va="center")


def _over_stretches(diagnostics: pd.DataFrame, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the middles of the stretches of time that have steps, and the mean of the values in each."""
    width_s = stretch_s(float(diagnostics["time_s"].max() - diagnostics["time_s"].min()))
    stretch = (diagnostics["time_s"].to_numpy(dtype=np.float64) / width_s + 1e-9).astype(np.int64)
    occupied = np.unique(stretch)
    reduced = np.array([values[stretch == index].mean() for index in occupied])
    return (occupied.astype(np.float64) + 0.5) * width_s, reduced
