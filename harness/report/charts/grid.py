"""Charts of a grid: each tracker's curves over what was varied, density for one, whose points lead to their runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from harness.analysis.curves import (
    BREAK_METRIC,
    BREAK_PERCENT,
    Point,
    curve_points,
    curve_quantities,
    labelled,
    points_of,
    runs_at,
)
from harness.analysis.tables import AXIS_LABELS
from harness.report.charts.chart import HIT_AREA, SERIES, Chart, Charts, Spec, colour_by, spec_of, strength, told
from harness.scoring.metrics.quantity import Quantity

DASHES: tuple[list[int], ...] = ([1, 0], [6, 3], [2, 3], [8, 3, 2, 3])
"""Lines beyond the colours change their dashes."""
MOST_TICKS = 8
NOTE = (
    "Means over seeds with 95 % intervals. Point at a value to read it, click it to go to its runs; a click on a name "
    "shows its line alone."
)

Where = tuple[str, str, float | str]
"""A point's label, axis and place on it."""


def grid_charts(table: pd.DataFrame, axes: Sequence[str], cells: Sequence[int | None]) -> dict[str, Charts]:
    """Return the charts over each axis, by its name in words.

    Args:
        table: The rows of ``runs.parquet``.
        axes: Keys of the axes other than network, density and demand.
        cells: For each row the number of the page's cell that lists it; None where none does.
    """
    points = curve_points(table, axes)
    leads = _leads(table.assign(cell=pd.array(list(cells), dtype="Int64")), {point.axis for point in points})
    return {
        AXIS_LABELS.get(axis, axis): _over(axis, [point for point in points if point.axis == axis], leads)
        for axis in dict.fromkeys(point.axis for point in points)
    }


def _leads(table: pd.DataFrame, axes: set[str]) -> dict[Where, list[int]]:
    """Return the cells whose runs stand behind each point."""
    done = labelled(table)
    found: dict[Where, list[int]] = {}
    for axis in sorted(axes):
        for (label, place), runs in runs_at(done, axis):
            found[label, axis, place] = sorted({int(cell) for cell in runs["cell"].dropna()})
    return found


def _over(axis: str, points: Sequence[Point], leads: Mapping[Where, list[int]]) -> Charts:
    names = dict.fromkeys(point.label for point in points)
    lines = tuple((name, SERIES[place % len(SERIES)]) for place, name in enumerate(names))
    charts = []
    for quantity in curve_quantities():
        rows = [
            _row(point, quantity, leads.get((name, axis, point.value), []))
            for name, curve in points_of(points, axis, quantity.key)
            for point in curve
        ]
        if rows:
            description = f"{quantity.label}, over {AXIS_LABELS.get(axis, axis)}, one line a tracker"
            spec = spec_of(description, rows, _layers(axis, quantity, lines, rows))
            charts.append(Chart(quantity.label, description, spec))
    return Charts(tuple(charts), lines, NOTE)


def _row(point: Point, quantity: Quantity, cells: list[int]) -> dict[str, Any]:
    decimals = quantity.decimals + 1
    low, high = point.ci95 or (None, None)
    interval = f"{low:.{decimals}f} to {high:.{decimals}f}" if point.ci95 is not None else "none from one seed"
    value = f"{point.mean:.{decimals}f}"
    return {
        "tracker": point.label, "place": point.value, "mean": point.mean, "low": low, "high": high,
        "value": value, "interval": interval, "seeds": str(point.seeds), "cells": cells,
    }  # fmt: skip


def _layers(
    axis: str, quantity: Quantity, lines: Sequence[tuple[str, str]], rows: Sequence[Mapping[str, Any]]
) -> list[Spec]:
    places = list(dict.fromkeys(row["place"] for row in rows))
    in_words = any(isinstance(place, str) for place in places)
    x: Spec = {
        "field": "place",
        "title": AXIS_LABELS.get(axis, axis),
        "type": "nominal" if in_words else "quantitative",
    }
    if in_words:
        x |= {"axis": {"labelAngle": 0, "grid": False}}
    else:
        few = {"values": sorted(places)} if len(places) <= MOST_TICKS else {}
        x |= {"scale": {"zero": False, "nice": False, "padding": 12}, "axis": {"grid": False, **few}}
    share = quantity.label.endswith("%")
    y: Spec = {"type": "quantitative", "title": None, "scale": {"zero": True} | ({"domain": [0, 102]} if share else {})}
    names = [name for name, _ in lines]
    dashes = [DASHES[place // len(SERIES) % len(DASHES)] for place in range(len(lines))]
    common: Spec = {"x": x, "color": colour_by("tracker", lines)}
    if in_words:
        common["xOffset"] = {"field": "tracker", "scale": {"domain": names}}
    dash: Spec = {"field": "tracker", "type": "nominal", "scale": {"domain": names, "range": dashes}, "legend": None}
    mean, low = {**y, "field": "mean"}, {**y, "field": "low"}
    tooltip = told(
        ("tracker", "tracker"), ("place", AXIS_LABELS.get(axis, axis)), ("value", quantity.label),
        ("interval", "95 % interval"), ("seeds", "seeds"),
    )  # fmt: skip
    spread: Spec = {
        "mark": {"type": "rule", "strokeWidth": 1.4} if in_words else {"type": "area", "tooltip": None},
        "encoding": {**common, "y": low, "y2": {"field": "high"}}
        | {"opacity": strength("tracker", 1.0 if in_words else 0.16)},
    }
    line: Spec = {
        "mark": {"type": "line", "strokeWidth": 2},
        "encoding": {**common, "y": mean, "strokeDash": dash, "opacity": strength("tracker")},
    }
    dots: Spec = {
        "mark": {"type": "point", "filled": True, "size": 46},
        "encoding": {**common, "y": mean, "opacity": strength("tracker")},
    }
    target: Spec = {
        "mark": {"type": "point", "filled": True, "size": HIT_AREA, "opacity": 0, "cursor": "pointer"},
        "encoding": {**common, "y": mean, "tooltip": tooltip},
    }
    drawn = [spread, dots, target] if in_words else [spread, line, dots, target]
    return [*_limit(axis, quantity, y), *drawn]


def _limit(axis: str, quantity: Quantity, y: Spec) -> list[Spec]:
    """Return the line below which a tracker is broken, where a chart shows that."""
    if quantity.key != BREAK_METRIC or axis != "density":
        return []
    at: Spec = {"y": {**y, "datum": BREAK_PERCENT}}
    text = {
        "type": "text",
        "text": "a tracker below this is broken",
        "align": "left",
        "dx": 4,
        "dy": 10,
        "fontSize": 11,
    }
    return [
        {"data": {"values": [{}]}, "mark": {"type": "rule", "strokeDash": [3, 3]}, "encoding": at},
        {"data": {"values": [{}]}, "mark": text, "encoding": at | {"x": {"value": 0}}},
    ]
