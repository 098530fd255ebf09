"""Charts of a run: the errors over time, whose points lead to that moment of the replay, and by visibility."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from harness.common.plots import stretch_s
from harness.report.charts.chart import HIT_AREA, STATES, Chart, Charts, Spec, colour_by, spec_of, strength, told
from harness.report.figures import COLOURS, ERROR_COLUMNS, NAMES, means_over_time

LINES = tuple(STATES.items())
OVER_TIME_NOTE = (
    "Mean absolute error while followed, in stretches of {:g} s. Point at a value to read it; click it to see that "
    "moment in the replay; a click on a name shows it alone."
)
VISIBILITY_NOTE = "Mean absolute error while followed, with 95 % intervals over vehicles."


def error_charts(errors: pd.DataFrame) -> Charts:
    """Return the mean absolute error in each stretch of time, one chart a quantity, one line a visibility.

    Args:
        errors: The rows of ``errors.parquet``; those of vehicles that no track follows are left out.
    """
    tracked = errors[errors["outcome"] == "tracked"]
    width_s = stretch_s(float(errors["time_s"].max()) if len(errors) else 1.0)
    new_egos = [{"time": float(start)} for start in errors.groupby("episode")["time_s"].min().iloc[1:]]
    charts = []
    for column, _, label in ERROR_COLUMNS:
        rows = _over_time(tracked, column, width_s)
        description = f"Mean absolute error of {label}, over time, for visible, partly hidden and hidden vehicles"
        if rows:
            charts.append(Chart(label, description, spec_of(description, rows, _time_layers(label, new_egos))))
    return Charts(tuple(charts), LINES, OVER_TIME_NOTE.format(width_s))


def visibility_charts(mae: Mapping[str, Any]) -> Charts:
    """Return bars of the mean absolute errors of ``metrics.json`` with their 95 % intervals, one chart a quantity."""
    charts = []
    for _, key, label in ERROR_COLUMNS:
        rows = [_bar(NAMES[state], mae[state], key) for state in COLOURS if (mae.get(state) or {}).get(key) is not None]
        description = f"Mean absolute error of {label}, for visible, partly hidden and hidden vehicles"
        if rows:
            charts.append(Chart(label, description, spec_of(description, rows, _bar_layers(label), height=180)))
    return Charts(tuple(charts), note=VISIBILITY_NOTE)


def _over_time(tracked: pd.DataFrame, column: str, width_s: float) -> list[dict[str, Any]]:
    rows = []
    for state in COLOURS:
        times, means, counts = means_over_time(tracked[tracked["state"] == state], column, width_s)
        # A gap splits the line: points on its two sides belong to different pieces.
        piece = np.cumsum(~np.isfinite(means))
        rows += [
            {
                "state": NAMES[state], "time": round(float(times[place]), 3), "mean": float(means[place]),
                "value": f"{means[place]:.2f}", "n": str(counts[place]), "piece": int(piece[place]),
                "stretch": f"{times[place] - width_s / 2:.1f} to {times[place] + width_s / 2:.1f} s",
                "at": round(float(times[place]), 1),
            }
            for place in np.flatnonzero(np.isfinite(means))
        ]  # fmt: skip
    return rows


def _time_layers(label: str, new_egos: list[dict[str, float]]) -> list[Spec]:
    x: Spec = {"field": "time", "type": "quantitative", "title": "time, s", "axis": {"grid": False}}
    y: Spec = {"field": "mean", "type": "quantitative", "title": None, "scale": {"zero": True}}
    common: Spec = {"x": x, "y": y, "color": colour_by("state", LINES)}
    tooltip = told(("state", "vehicles"), ("stretch", "time"), ("value", label), ("n", "vehicle-steps"))
    marks: list[Spec] = []
    if new_egos:
        text = {"type": "text", "text": "new ego", "align": "left", "baseline": "top", "dx": 3, "fontSize": 11}
        at = {"x": {"field": "time", "type": "quantitative"}}
        marks = [
            {"data": {"values": new_egos}, "mark": {"type": "rule", "strokeDash": [2, 3]}, "encoding": at},
            {"data": {"values": new_egos}, "mark": text, "encoding": at | {"y": {"value": 0}}},
        ]
    return [
        *marks,
        {
            "mark": {"type": "line", "strokeWidth": 2},
            "encoding": {**common, "detail": {"field": "piece", "type": "nominal"}, "opacity": strength("state")},
        },
        {
            "mark": {"type": "point", "filled": True, "size": 24},
            "encoding": {**common, "opacity": strength("state")},
        },
        {
            "mark": {"type": "point", "filled": True, "size": HIT_AREA, "opacity": 0, "cursor": "pointer"},
            "encoding": {**common, "tooltip": tooltip},
        },
    ]


def _bar(name: str, row: Mapping[str, Any], key: str) -> dict[str, Any]:
    low, high = row.get(f"{key}_ci95") or (None, None)
    share = row.get("followed_percent")
    return {
        "state": name, "mean": row[key], "low": low, "high": high, "value": f"{row[key]:.2f}",
        "interval": "none" if low is None else f"{low:.2f} to {high:.2f}", "n": str(row.get("n") or 0),
        "followed": "-" if share is None else f"{share:.0f} %",
    }  # fmt: skip


def _bar_layers(label: str) -> list[Spec]:
    names = [name for name, _ in LINES]
    y: Spec = {"type": "quantitative", "title": None, "scale": {"zero": True}}
    x: Spec = {
        "field": "state",
        "type": "nominal",
        "title": None,
        "scale": {"domain": names},
        "axis": {"labelAngle": 0},
    }
    tooltip = told(
        ("state", "vehicles"), ("value", label), ("interval", "95 % interval over vehicles"),
        ("followed", "followed"), ("n", "vehicle-steps"),
    )  # fmt: skip
    mean, low = {**y, "field": "mean"}, {**y, "field": "low"}
    return [
        {
            "mark": {"type": "bar", "width": {"band": 0.6}},
            "encoding": {"x": x, "y": mean, "color": colour_by("state", LINES), "tooltip": tooltip},
        },
        {
            "mark": {"type": "rule", "strokeWidth": 1.4, "stroke": "var(--ink)", "tooltip": None},
            "encoding": {"x": x, "y": low, "y2": {"field": "high"}},
        },
        {
            "mark": {"type": "text", "baseline": "bottom", "dy": -4, "dx": 16, "align": "left", "tooltip": None},
            "encoding": {"x": x, "y": mean, "text": {"field": "value"}},
        },
    ]
