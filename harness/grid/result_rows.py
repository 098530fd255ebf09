"""The rows of a grid: the results of each run, and one table of all of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from harness.grid.cells import GridPlan, PlannedRun
from harness.storage.grid_rows import TEXT_COLUMNS, Row, flattened
from harness.storage.schema import RUN_IDENTITY, RUN_OUTCOME


def finished_row(run: PlannedRun, metrics: Mapping[str, Any], total_s: float) -> Row:
    """Return the row of a run that ended well."""
    scores = {name: value for name, value in metrics.items() if name != "run"}
    return {**run.identity(), "succeeded": True, "error": None, "total_s": total_s, **flattened(scores)}


def failed_row(run: PlannedRun, error: str, total_s: float) -> Row:
    """Return the row of a run that did not."""
    return {**run.identity(), "succeeded": False, "error": " ".join(error.split()), "total_s": total_s}


def assemble(grid: GridPlan, rows: Mapping[str, Row]) -> pd.DataFrame:
    """Return the table of a grid, one row for each run in the grid's order, columns in a fixed order."""
    ordered = [rows[run.key] for run in grid.runs]
    metrics = dict.fromkeys(name for row in ordered for name in row)
    identity, outcome = ([column.name for column in columns] for columns in (RUN_IDENTITY, RUN_OUTCOME))
    head = [*identity, *grid.axes, *outcome]
    columns = [*head, *sorted(name for name in metrics if name not in head)]
    table = pd.DataFrame({name: [row.get(name) for row in ordered] for name in columns})
    for name in columns:
        if name in TEXT_COLUMNS:
            table[name] = table[name].astype(object).where(table[name].notna(), None)
        elif name not in ("seed", "succeeded"):
            table[name] = table[name].astype("float64")
    return table
