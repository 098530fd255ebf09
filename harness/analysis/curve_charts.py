"""Charts of a grid: a curve per tracker over what was varied; points link to their runs."""

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
from harness.common.charts import Charts, curves, lines_of
from harness.scoring.metrics.quantity import Quantity

NOTE = (
    "Means over seeds with 95 % intervals. MAE is the mean absolute error, HOTA a score of detection and identity, and "
    "hidden cost the mean position error of hidden vehicles, 10 m for one without a track; hidden CRPS also "
    "scores the deviations that tracks state."
)
HINT = "Point at a value to read it, click it to go to its runs; a click on a name shows its line alone."

Where = tuple[str, str, float | str]
"""A point's label, axis and place on it."""


def grid_charts(table: pd.DataFrame, axes: Sequence[str], cells: Sequence[int | None]) -> dict[str, Charts]:
    """Return the charts over each axis of the rows of ``runs.parquet`` by the axis's label.

    ``axes`` are the keys beside network, density and demand; ``cells`` has each row's number of the page's cell that
    lists it, or None.
    """
    points = curve_points(table, axes)
    shown = dict.fromkeys(point.axis for point in points)
    done = labelled(table.assign(cell=pd.array(list(cells), dtype="Int64")))
    # The cells whose runs stand behind each point.
    leads: dict[Where, list[int]] = {
        (label, axis, place): sorted({int(cell) for cell in runs["cell"].dropna()})
        for axis in shown
        for (label, place), runs in runs_at(done, axis)
    }
    return {AXIS_LABELS.get(axis, axis): curve_charts(points, axis, leads) for axis in shown}


def curve_charts(points: Sequence[Point], axis: str, leads: Mapping[Where, list[int]] | None = None) -> Charts:
    """Return the charts over one axis, one a quantity, one line a tracker; points lead to cells of a page."""
    here = [point for point in points if point.axis == axis]
    lines = lines_of(list(dict.fromkeys(point.label for point in here)))
    heading, charts = AXIS_LABELS.get(axis, axis), []
    for quantity in curve_quantities():
        rows = [
            _row(point, quantity, (leads or {}).get((name, axis, point.value), []))
            for name, curve in points_of(here, axis, quantity.key)
            for point in curve
        ]
        if rows:
            broken = quantity.key == BREAK_METRIC and axis == "density"
            limit = (BREAK_PERCENT, "a tracker below this is broken") if broken else None
            told = (("value", quantity.label), ("interval", "95 % interval"), ("seeds", "seeds"))
            tooltip = (("series", "tracker"), ("place", heading), *told)
            description = f"{quantity.label}, over {heading}, one line a tracker"
            better = f"{quantity.better} is better"
            charts.append(curves(quantity.label, description, heading, rows, lines, tooltip, limit, better=better))
    return Charts(tuple(charts), lines, NOTE, HINT)


def _row(point: Point, quantity: Quantity, cells: list[int]) -> dict[str, Any]:
    decimals = quantity.decimals + 1
    low, high = point.ci95 or (None, None)
    none = "none from one seed" if point.seeds < 2 else "none, since all seeds are equal"
    interval = f"{low:.{decimals}f} to {high:.{decimals}f}" if point.ci95 is not None else none
    return {
        "series": point.label,
        "place": point.value,
        "mean": point.mean,
        "low": low,
        "high": high,
        "value": f"{point.mean:.{decimals}f}",
        "interval": interval,
        "seeds": str(point.seeds),
        "cells": cells,
    }
