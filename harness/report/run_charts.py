"""Charts of a run: errors over time, with links into the replay, errors by visibility, and the filter's diagnostics."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from harness.common.charts import Charts, curves, lines_of
from harness.common.numbers import number
from harness.running.finished import RecordedRun
from harness.storage import run_folder as runfolder
from harness.storage.tables import floats
from mmpf.numerics.arrays import FloatArray

NAMES = {"visible": "visible", "partial": "partly hidden", "hidden": "hidden"}
LINES = tuple((name, f"var(--{state})") for state, name in NAMES.items())
ERROR_COLUMNS = (
    ("lon_error_m", "lon_m", "longitudinal error, m"),
    ("lat_error_m", "lat_m", "lateral error, m"),
    ("speed_error_mps", "speed_mps", "speed error, m/s"),
)
OVER_TIME, BY_VISIBILITY, DIAGNOSTICS = "error_over_time.png", "error_by_visibility.png", "diagnostics.png"
"""Files of the pictures in a run's folder."""
FEWEST_SAMPLES = 5
HINT = "Point at a value to read it; click it to see that moment in the replay; a click on a name shows it alone."
LEVELS = (
    ("components", "Components", 1.0),
    ("effective_share", "Effective sample size, % of particles", 100.0),
    ("association_entropy", "Association entropy, nats per component", 1.0),
)
EVENTS = ("births", "deaths", "merges", "reclusterings")
DIAGNOSTIC_COLUMNS = ("time_s", "episode", *(column for column, _, _ in LEVELS))


def error_charts(errors: pd.DataFrame) -> Charts:
    """Return the mean absolute error in each stretch of time, one chart a quantity, one line a visibility.

    Rows of ``errors.parquet`` of vehicles that no track follows are left out.
    """
    tracked = errors[errors["outcome"] == "tracked"]
    width_s = _stretch_s(float(errors["time_s"].max()) if len(errors) else 1.0)
    charts = []
    for column, _, label in ERROR_COLUMNS:
        rows = [row for state in NAMES for row in _over_time(tracked, state, column, width_s)]
        tooltip = (("series", "vehicles"), ("stretch", "time"), ("value", label), ("n", "samples"))
        description = f"Mean absolute {label}, over time, for visible, partly hidden and hidden vehicles"
        if rows:
            charts.append(curves(label, description, "time, s", rows, LINES, tooltip, marks=_new_egos(errors)))
    note = f"Mean absolute error while followed, in stretches of {width_s:g} s."
    return Charts(tuple(charts), LINES, note, HINT)


def visibility_charts(mae: Mapping[str, Any]) -> Charts:
    """Return the mean absolute errors of ``metrics.json`` with their 95 % intervals, one chart a quantity."""
    charts = []
    for _, key, label in ERROR_COLUMNS:
        rows = [_state(state, mae[state], key) for state in NAMES if (mae.get(state) or {}).get(key) is not None]
        interval = ("interval", "95 % interval over vehicles")
        tooltip = (("series", "vehicles"), ("value", label), interval, ("followed", "followed"), ("n", "samples"))
        description = f"Mean absolute {label}, for visible, partly hidden and hidden vehicles"
        if rows:
            charts.append(curves(label, description, "vehicles", rows, LINES, tooltip))
    return Charts(tuple(charts), note="Mean absolute error while followed, with 95 % intervals over vehicles.")


def diagnostics_of(run: RecordedRun) -> pd.DataFrame | None:
    """Return the tracker's diagnostics of each step; None without any."""
    told = (run.folder / runfolder.DIAGNOSTICS).is_file()
    return runfolder.read_table(run.folder, runfolder.DIAGNOSTICS, "folder", DIAGNOSTIC_COLUMNS) if told else None


def diagnostics_charts(diagnostics: pd.DataFrame) -> Charts:
    """Return what went on in a particle filter: means in stretches of time with the least and the greatest step."""
    width_s = _stretch_s(float(diagnostics["time_s"].max() - diagnostics["time_s"].min()))
    # An ego's first scan starts a component for every detection, which would dwarf all that follows.
    later = diagnostics[diagnostics["episode"].duplicated()]
    step_s = float(diagnostics["time_s"].diff().median()) if len(diagnostics) > 1 else 1.0
    events = [name for name in EVENTS if name in later and later[name].any()]
    lines = lines_of(["mean", *events])
    levels = [(title, scale * floats(diagnostics, name)) for name, title, scale in LEVELS]
    shown = [(title, _levels(diagnostics, "mean", level, width_s)) for title, level in levels]
    rates = [row for name in events for row in _levels(later, name, floats(later, name) / step_s, width_s, band=False)]
    tooltip = (("series", "what"), ("stretch", "time"), ("value", "mean"), ("range", "least to greatest step"))
    marks = _new_egos(diagnostics)
    charts = [
        curves(title, f"{title}, over time", "time, s", rows, lines, tooltip, marks=marks)
        for title, rows in (*shown, ("Events a second, without the first scan", rates))
        if rows
    ]
    note = f"Means over {width_s:g} s; bands from the least to the greatest step."
    return Charts(tuple(charts), lines[1:], note, HINT)  # levels have charts of one line each, which need no legend


def _new_egos(steps: pd.DataFrame) -> list[tuple[float, str]]:
    """Return when another vehicle became the ego."""
    return [(float(start), "new ego") for start in steps.groupby("episode")["time_s"].min().iloc[1:]]


def _levels(
    table: pd.DataFrame, series: str, values: FloatArray, width_s: float, band: bool = True
) -> list[dict[str, Any]]:
    points = _in_stretches(table, series, values, width_s, ".3g")
    points["range"] = [f"{low:.3g} to {high:.3g}" for low, high in zip(points["low"], points["high"], strict=True)]
    return _records(points, without=["n"] if band else ["n", "low", "high"])


def _over_time(table: pd.DataFrame, state: str, column: str, width_s: float) -> list[dict[str, Any]]:
    rows = table[table["state"] == state]
    points = _in_stretches(rows, NAMES[state], np.abs(floats(rows, column)), width_s, ".2f")
    points = points[points["n"] >= FEWEST_SAMPLES]
    # A gap splits the line: points on its two sides belong to different pieces.
    points = points.assign(piece=points.index - np.arange(len(points)), n=points["n"].astype(str))
    return _records(points, without=["low", "high"])


def _in_stretches(rows: pd.DataFrame, series: str, values: FloatArray, width_s: float, digits: str) -> pd.DataFrame:
    """Return the points of a line: mean, least and greatest value and number of samples of each stretch of time."""
    stretch = (floats(rows, "time_s") / width_s + 1e-9).astype(np.int64)
    points = pd.Series(values).groupby(stretch).agg(["mean", "min", "max", "size"])
    middle_s = (points.index.to_numpy() + 0.5) * width_s
    return points.set_axis(["mean", "low", "high", "n"], axis=1).assign(
        series=series,
        place=middle_s.round(3),
        at=middle_s.round(1),
        value=[f"{mean:{digits}}" for mean in points["mean"]],
        stretch=[f"{number * width_s:.1f} to {(number + 1) * width_s:.1f} s" for number in points.index],
    )


def _records(points: pd.DataFrame, without: list[str]) -> list[dict[str, Any]]:
    rows = points.drop(columns=without).to_dict("records")
    return [{str(name): value for name, value in row.items()} for row in rows]


def _state(state: str, row: Mapping[str, Any], key: str) -> dict[str, Any]:
    low, high = row.get(f"{key}_ci95") or (None, None)
    share, name = row.get("followed_percent"), NAMES[state]
    return {
        "series": name,
        "place": name,
        "mean": row[key],
        "low": low,
        "high": high,
        "value": number(row[key], 2),
        "interval": "none" if low is None else f"{low:.2f} to {high:.2f}",
        "n": str(row.get("n") or 0),
        "followed": number(share, 0, " %"),
    }


def _stretch_s(duration_s: float) -> float:
    """Return how long a stretch of time is that errors are averaged over, so that there are at most 40."""
    return next((width for width in (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0) if duration_s / width <= 40.0), 60.0)
