"""Rows of a grid on disk: the flat result of each run in a small file."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.common.files import write_text
from harness.common.untrusted_files import read_json
from harness.storage.schema import TABLES
from mmpf.numerics.arrays import FloatArray

Row = dict[str, Any]

TEXT_COLUMNS = frozenset(column.name for column in TABLES["runs.parquet"].columns if column.is_text)
NOT_FLAT = ("in_plain_view.vehicles",)
"""Lists of whatever length with words in them: a run's own folder has them."""


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
    """Write a run's row atomically."""
    final = folder / f"{key}.json"
    write_text(final, json.dumps(row, allow_nan=False))


def read_rows(folder: Path, keys: Iterable[str]) -> dict[str, Row]:
    """Return the rows that are there and whole, by key; a damaged one counts as not there."""
    rows = {}
    for key in keys:
        path = folder / f"{key}.json"
        if not path.is_file():
            continue
        with suppress(ValueError):
            if _is_row(row := read_json(path)):
                rows[key] = row
    return rows


def _is_row(content: Row) -> bool:
    """Return whether a file holds what ``write_row`` writes: an outcome, and single values of the columns' types."""
    if not isinstance(content.get("succeeded"), bool) or "error" not in content:
        return False
    return all(
        value is None or isinstance(value, str if name in TEXT_COLUMNS else int | float)
        for name, value in content.items()
    )
