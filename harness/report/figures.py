"""The figures of one run: the road at a telling moment, the error over time, the mean error by visibility."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.report.diagnostics_figure import FILE as DIAGNOSTICS
from harness.report.diagnostics_figure import diagnostics_figure
from harness.report.scene import GREEN, ORANGE, VERMILION, scene_figure
from harness.running.run import Pictured
from harness.writing.plots import mark_new_egos, stretch_s, strip
from mmpf.compute.arrays import FloatArray

COLOURS = {"visible": GREEN, "partial": ORANGE, "hidden": VERMILION}
NAMES = {"visible": "visible", "partial": "partly hidden", "hidden": "hidden"}
ERROR_COLUMNS = (
    ("lon_error_m", "lon_m", "longitudinal position, m"),
    ("lat_error_m", "lat_m", "lateral position, m"),
    ("speed_error_mps", "speed_mps", "speed, m/s"),
)
SCENE, OVER_TIME, BY_VISIBILITY = "scene.png", "error_over_time.png", "error_by_visibility.png"
FEWEST_SAMPLES = 5


def draw_figures(folder: Path, pictured: Pictured) -> None:
    """Draw all figures of a run into a new folder."""
    folder.mkdir()
    title, moment, scored = pictured.title, pictured.moment, pictured.scored
    if moment is not None:
        scene = scene_figure(
            moment.look.frame,
            moment.look.observation,
            moment.tracks,
            pictured.road,
            pictured.sensor.range_m,
            moment.particles,
            f"{title}: {moment.look.frame.time_s:.1f} s",
        )
        scene.savefig(folder / SCENE)
    error_over_time(scored.errors, title).savefig(folder / OVER_TIME)
    error_by_visibility(scored.metrics["mae"], title).savefig(folder / BY_VISIBILITY)
    if pictured.diagnostics is not None:
        diagnostics_figure(pictured.diagnostics, title).savefig(folder / DIAGNOSTICS)


def error_over_time(errors: pd.DataFrame, title: str) -> Figure:
    """Return the mean absolute error in each stretch of time, one panel a quantity, one line a visibility.

    Args:
        errors: The run's table of errors; rows of vehicles that no track follows are left out.
        title: Heading.
    """
    tracked = errors[errors["outcome"] == "tracked"]
    width_s = stretch_s(float(errors["time_s"].max()) if len(errors) else 1.0)
    figure = Figure(figsize=(9.0, 7.0), dpi=120, layout="constrained")
    panels = figure.subplots(len(ERROR_COLUMNS), 1, sharex=True)
    for axes, (column, _, label) in zip(panels, ERROR_COLUMNS, strict=True):
        ends = {}
        for state, colour in COLOURS.items():
            times, means = _means_over_time(tracked[tracked["state"] == state], column, width_s)
            axes.plot(times, means, color=colour, linewidth=1.8, marker="o", markersize=3)
            if np.isfinite(means).any():
                last = np.flatnonzero(np.isfinite(means))[-1]
                ends[state] = (times[last], means[last])
        axes.set_ylim(bottom=0.0)
        axes.set_ylabel(label)
        _label_lines(axes, ends)
        mark_new_egos(axes, errors)
        strip(axes)
    longest_s = width_s * np.ceil(float(tracked["time_s"].max()) / width_s + 1e-9) if len(tracked) else 1.0
    panels[-1].set_xlim(0.0, 1.16 * longest_s)
    panels[-1].set_xlabel("time, s")
    figure.suptitle(f"{title}: mean absolute error in stretches of {width_s:g} s", fontsize=11)
    return figure


def error_by_visibility(mae: Mapping[str, Any], title: str) -> Figure:
    """Return bars of the mean absolute error with their 95 % intervals, one panel a quantity.

    Args:
        mae: The table ``mae`` of ``metrics.json``.
        title: Heading.
    """
    figure = Figure(figsize=(9.0, 3.6), dpi=120, layout="constrained")
    panels = figure.subplots(1, len(ERROR_COLUMNS))
    for axes, (_, key, label) in zip(panels, ERROR_COLUMNS, strict=True):
        highest = 0.0
        for place, state in enumerate(COLOURS):
            highest = max(highest, _bar(axes, place, state, mae[state], key))
        axes.set_xticks(range(len(COLOURS)), [f"{NAMES[state]}\nn = {mae[state]['n'] or 0}" for state in COLOURS])
        axes.tick_params(axis="x", length=0)
        axes.set_ylim(0.0, 1.15 * highest or 1.0)
        axes.set_ylabel(label)
        strip(axes)
    figure.suptitle(f"{title}: mean absolute error, 95 % intervals over vehicles, n samples", fontsize=11)
    return figure


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


def _means_over_time(rows: pd.DataFrame, column: str, width_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the middle of each stretch of time and the mean absolute value in it, nan where too few samples are."""
    if not len(rows):
        return np.zeros(0), np.zeros(0)
    stretch = (rows["time_s"].to_numpy(dtype=np.float64) / width_s + 1e-9).astype(np.int64)
    count = np.bincount(stretch)
    total = np.bincount(stretch, weights=np.abs(rows[column].to_numpy(dtype=np.float64)))
    means = np.where(count >= FEWEST_SAMPLES, total / np.maximum(count, 1), np.nan)
    return (np.arange(len(count), dtype=np.float64) + 0.5) * width_s, means.astype(np.float64)


def _label_lines(axes: Axes, ends: Mapping[str, tuple[float, float]]) -> None:
    """Write each line's name at its end, moved apart where they would overlap."""
    top = axes.get_ylim()[1]
    height = -np.inf
    for state, (time, mean) in sorted(ends.items(), key=lambda item: item[1][1]):
        height = max(mean, height + 0.11 * top, 0.05 * top)
        axes.annotate(
            NAMES[state], (time, height), xytext=(6, 0), textcoords="offset points", color=COLOURS[state], va="center"
        )
