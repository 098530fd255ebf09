"""Rows of a grid: a run's result as flat columns, a small file each on the way, one table in the end."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from harness.common.files import write_text
from harness.grid.cells import DENSITY, MISMATCH, RECORDING, Grid, PlannedRun
from mmpf.compute.arrays import FloatArray

if TYPE_CHECKING:
    import pandas as pd


Row = dict[str, Any]

TEXT_COLUMNS = (
    *("net", "demand", RECORDING, "tracker", "variant", "model", "update", "error", MISMATCH),
    *(f"recording.{name}" for name in ("file", "format", "ego")),
    *(f"episode.{name}" for name in ("kind", "ego", "provoked")),
    *(f"drive.{name}" for name in ("ended", "collided_with")),
)
NOT_FLAT = ("in_plain_view.vehicles",)
"""Lists of whatever length with words in them: a run's own folder has them."""
FIRST_COLUMNS = ("net", DENSITY, "demand", "tracker", "variant", "model", "update", "seed")
OUTCOME_COLUMNS = ("succeeded", "error", "total_s")


def finished_row(run: PlannedRun, metrics: Mapping[str, Any], total_s: float) -> Row:
    """Return the row of a run that ended well."""
    scores = {name: value for name, value in metrics.items() if name != "run"}
    return {**run.identity(), "succeeded": True, "error": None, "total_s": total_s, **flattened(scores)}


def failed_row(run: PlannedRun, error: str, total_s: float) -> Row:
    """Return the row of a run that did not."""
    return {**run.identity(), "succeeded": False, "error": " ".join(error.split()), "total_s": total_s}


def flattened(table: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return nested tables and lists as one, keys joined by dots; intervals end in ``.low`` and ``.high``."""
    flat: dict[str, Any] = {}
    for key, value in table.items():
        name = f"{prefix}{key}"
        if key.endswith("_ci95"):
            low, high = value if value is not None else (None, None)
            flat |= {f"{name}.low": low, f"{name}.high": high}
        elif isinstance(value, Mapping):
            flat |= flattened(value, f"{name}.")
        elif name in NOT_FLAT:
            continue
        elif isinstance(value, list):
            flat |= flattened({str(place): item for place, item in enumerate(value)}, f"{name}.")
        else:
            flat[name] = value
    return flat


def column_of(table: pd.DataFrame, name: str) -> FloatArray:
    """Return a column's values, nan where the table has none: it may be older than the metric; shape (rows,)."""
    return table[name].to_numpy(dtype=np.float64) if name in table else np.full(len(table), np.nan)


def write_row(folder: Path, key: str, row: Row) -> None:
    """Write a run's row so that it is there whole or not at all."""
    final = folder / f"{key}.json"
    write_text(final, json.dumps(row, allow_nan=False))


def read_rows(folder: Path, keys: Iterable[str]) -> dict[str, Row]:
    """Return the rows that are there and whole, by key; a damaged one counts as not there."""
    rows = {}
    for key in keys:
        path = folder / f"{key}.json"
        if not path.is_file():
            continue
        try:
            row = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            continue
        if _is_row(row):
            rows[key] = row
    return rows


def _is_row(content: object) -> bool:
    """Return whether a file holds what ``write_row`` writes: an outcome, and single values of the columns' types."""
    if not isinstance(content, dict) or not isinstance(content.get("succeeded"), bool) or "error" not in content:
        return False
    return all(
        value is None or isinstance(value, str if name in TEXT_COLUMNS else int | float)
        for name, value in content.items()
    )


def assemble(grid: Grid, rows: Mapping[str, Row]) -> pd.DataFrame:
    """Return the table of a grid, one row for each run in the grid's order, columns in a fixed order."""
    import pandas as pd  # noqa: PLC0415

    ordered = [rows[run.key] for run in grid.runs]
    metrics = dict.fromkeys(name for row in ordered for name in row)
    head = [*FIRST_COLUMNS, *grid.axes, *OUTCOME_COLUMNS]
    columns = [*head, *sorted(name for name in metrics if name not in head)]
    table = pd.DataFrame({name: [row.get(name) for row in ordered] for name in columns})
    for name in columns:
        if name in TEXT_COLUMNS:
            table[name] = table[name].astype(object).where(table[name].notna(), None)
        elif name not in ("seed", "succeeded"):
            table[name] = table[name].astype("float64")
    return table
