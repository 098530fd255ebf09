"""A grid's folder: one process at a time may use it, and only the same grid may resume it; and its rows.

The flat result of each run lies in a small file.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.common.errors import InputError
from harness.common.files import check_unlinked, is_temporary, write_text, writing
from harness.common.untrusted_files import read_json
from harness.storage import ownership
from harness.storage.lock import LOCK, lock_within
from harness.storage.schema import TABLES
from mmpf.numerics.arrays import FloatArray

ROWS, RUNS, GRID, KEPT, FIGURES = "runs", "runs.parquet", "grid.json", "kept", "figures"


@contextmanager
def open_grid_folder(out: Path, resume: bool, kind: str = ownership.STRESS) -> Iterator[Path]:
    """Make or resume a grid's folder, lock it, and yield the folder of its rows.

    Raises:
        InputError: It may not be taken up, holds a link, can't be written, or another process is writing it.
    """
    if out.exists() and not resume:
        raise InputError(f"`out`: {out} exists; add `resume` to go on with it, or choose another folder")
    rows = out / ROWS
    with writing("out", out):
        try:
            if out.exists() and not out.is_dir():
                raise InputError(f"`out`: {out} is a file; choose another folder")
            there = out.iterdir() if out.is_dir() else ()
            holds_files = any(entry.name != LOCK and not is_temporary(entry.name) for entry in there)
            if holds_files and ownership.kind_of(out) != kind:
                raise InputError(f"`out`: {out} is not a {ownership.plain(kind)}'s folder; choose another folder")
            check_unlinked(out, out.rglob("*"), "out")
            out.mkdir(parents=True, exist_ok=True)
            lock = lock_within(out)
        except OSError:
            # Only an empty one goes.
            with suppress(OSError):
                out.rmdir()
            raise
    try:
        with writing("out", out):
            if ownership.kind_of(out) is None:
                ownership.claim(out, kind)
            rows.mkdir(exist_ok=True)
            _clean(out, rows, kind)
        yield rows
    finally:
        lock.release()


def _clean(out: Path, rows: Path, kind: str) -> None:
    """Remove half-written files of a process that was killed."""
    for folder in (out, rows, out / FIGURES, out / KEPT, *(out / KEPT).glob("*"), *(out / KEPT).glob(f"*/{FIGURES}")):
        for path in folder.iterdir() if folder.is_dir() else ():
            if is_temporary(path.name) and path.is_file():
                path.unlink()
    for path in rows.iterdir():
        if not path.is_file():
            raise InputError(f"`out`: {path} is no file of a {ownership.plain(kind)}; move it away")


def check_same_grid(out: Path, rows: Path, keys: set[str]) -> None:
    """Check that a grid covers everything that its folder holds, so that no finished run drops out of the tables.

    Raises:
        InputError: The folder holds runs of another grid, or runs whose own files are gone.
    """
    there = {path.stem for path in rows.glob("*.json")}
    if others := len(there - keys):
        raise InputError(
            f"`out`: {out} holds {others} runs of another grid, which this one would leave out; choose another folder "
            f"or the options that {out / GRID} tells"
        )
    if not there >= keys and _rows_in(out / RUNS) > len(there):
        raise InputError(f"`out`: runs in {out / RUNS} have no files in {rows} any more; choose another folder")


def _rows_in(table: Path) -> int:
    """Return how many rows a table has; none if it is missing or broken, and so nothing to lose."""
    try:
        return int(pq.read_metadata(table).num_rows) if table.is_file() else 0
    except (OSError, pa.ArrowException):
        return 0


Row = dict[str, Any]

TEXT_COLUMNS = frozenset(column.name for column in TABLES[RUNS].columns if column.is_text)
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
    write_text(folder / f"{key}.json", json.dumps(row, allow_nan=False))


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
