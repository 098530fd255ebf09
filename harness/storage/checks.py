"""Reads tables of a run folder that may come from elsewhere: sizes first, from the file's own footer, then kinds."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.common.errors import InputError
from harness.common.untrusted_files import MB, MOST_TABLE_BYTES, check_file

MOST_ROWS, MOST_COLUMNS, MOST_CELLS = 60_000_000, 5_000, 1_500_000_000
LONGEST_TEXT = 2_000
TEXTS = frozenset(
    {
        *("vehicle_id", "truth_id", "occluder_id", "state", "outcome", "label", "error"),
        *("kind", "visibility", "fate"),
        *("net", "demand", "replay", "tracker", "variant", "model", "update"),
    }
)
LARGEST = {
    "step": 1e9, "episode": 1e9, "track_id": 2.0**53, "time_s": 1e9, "lon_m": 1e8, "lat_m": 1e8,
    "length_m": 100.0, "width_m": 100.0, "heading_rad": 1e3,
}  # fmt: skip
"""Columns in which no run leaves a gap, and what their numbers stay below."""
POSITIVE = frozenset({"length_m", "width_m"})
DAMAGE = (ValueError, TypeError, LookupError, ArithmeticError, AttributeError, AssertionError)


@dataclass(frozen=True)
class Until:
    """The first rows of a table that is sorted by a column: those where it is at most ``last``."""

    column: str
    last: int


def read_parquet(path: Path, parameter: str, until: Until | None = None) -> pd.DataFrame:
    """Return a table after checking how much it holds; texts are unpacked only when their lengths are known.

    Args:
        path: The file.
        parameter: Parameter that named it, for messages.
        until: The rows that are wanted; None for all.

    Raises:
        InputError: It is no ordinary file, has too many rows or columns, or columns of another kind than numbers and
            texts.
    """
    check_file(path, MOST_TABLE_BYTES, parameter)
    footer = pq.read_metadata(path)
    groups = list(range(footer.num_row_groups)) if until is None else groups_until(footer, until)
    rows, columns = sum(footer.row_group(group).num_rows for group in groups), footer.num_columns
    if rows > MOST_ROWS or columns > MOST_COLUMNS or rows * columns > MOST_CELLS:
        raise InputError(
            f"`{parameter}`: {path} has {rows} rows of {columns} columns; at most {MOST_ROWS} rows are read, so make a "
            "shorter run"
        )
    schema = pq.read_schema(path)
    for field in schema:
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        if not (_is_number(kind) or _is_text(kind) or pa.types.is_null(kind)):
            raise InputError(f"`{parameter}`: {path}: {field.name[:60]} holds {str(kind)[:60]}; make the run again")
    texts = [field.name for field in schema if _is_text(field.type)]
    if until is None:
        table = pq.read_table(path, read_dictionary=texts)
    else:
        with pq.ParquetFile(path, read_dictionary=texts) as file:
            table = file.read_row_groups(groups)
        table = table.filter(pa.compute.less_equal(table[until.column], until.last))
    for name in texts:
        for chunk in table[name].chunks:
            _check_texts(chunk, f"`{parameter}`: {path}: {name[:60]}")
        place = table.schema.get_field_index(name)
        table = table.set_column(place, name, table[name].cast(pa.string()))
    if table.nbytes > MOST_TABLE_BYTES:
        raise InputError(f"`{parameter}`: {path} has {table.nbytes / MB:.0f} MB when unpacked; make a shorter run")
    frame: pd.DataFrame = table.to_pandas()
    return frame


def groups_until(footer: pq.FileMetaData, until: Until) -> list[int]:
    """Return the row groups of a table that may hold wanted rows.

    Raises:
        LookupError: The table lacks the column.
    """
    place = footer.schema.names.index(until.column) if until.column in footer.schema.names else -1
    if place < 0:
        raise LookupError(f"there is no column {until.column}")

    def begins_before(group: int) -> bool:
        known = footer.row_group(group).column(place).statistics
        return known is None or not known.has_min_max or known.min <= until.last

    return [group for group in range(footer.num_row_groups) if begins_before(group)]


def check_kinds(table: pd.DataFrame, columns: Collection[str], place: str) -> None:
    """Refuse columns that hold texts where numbers belong, or the other way round.

    Args:
        table: The table.
        columns: Columns that are needed.
        place: Where the table is, for the message.

    Raises:
        InputError: A column is of the wrong kind, or a step, a time, an identity or a place is none that can be.
    """
    for name in columns:
        numbers = pd.api.types.is_numeric_dtype(table[name])
        if table[name].notna().any() and numbers == (name in TEXTS):
            wanted = "texts" if name in TEXTS else "numbers"
            raise InputError(f"{place}: {name} holds no {wanted}; make the run again")
        if name in TEXTS or not len(table):
            continue
        # What is not finite is not below anything.
        if name in LARGEST and not (np.abs(table[name].to_numpy(dtype=np.float64)) < LARGEST[name]).all():
            raise InputError(f"{place}: {name} holds a number that none can be; make the run again")
        if name in POSITIVE and not (table[name].to_numpy(dtype=np.float64) > 0.0).all():
            raise InputError(f"{place}: {name} holds a number that none can be; make the run again")


def check_order(table: pd.DataFrame, place: str) -> None:
    """Refuse a table whose steps are not in the order of time, in which every run writes them.

    Raises:
        InputError: They are not.
    """
    if (np.diff(table["step"].to_numpy(dtype=np.float64)) < 0.0).any():
        raise InputError(f"{place}: its rows are not in the order of time; make the run again")


def rows_of(folder: Path) -> dict[str, int]:
    """Return how many rows each table of a folder has, by file, for the manifest."""
    return {path.name: pq.read_metadata(path).num_rows for path in sorted(folder.glob("*.parquet"))}


def check_rows(path: Path, manifest: Path, parameter: str) -> None:
    """Refuse a table with more or fewer rows than the manifest has noted; one that noted none says nothing.

    Raises:
        InputError: It has.
    """
    try:
        noted = json.loads(manifest.read_text(encoding="utf-8"))["rows"][path.name]
    except (OSError, ValueError, LookupError, TypeError, RecursionError):
        return
    rows = pq.read_metadata(path).num_rows
    if rows != noted:
        raise InputError(
            f"`{parameter}`: {path} has {rows} rows, the run wrote {str(noted)[:20]}; make the run again, or take rows "
            f"out of {manifest.name} if you meant that"
        )


@contextmanager
def sound_tables(folder: Path, parameter: str) -> Iterator[None]:
    """Turn what goes wrong over tables that contradict each other into one line that names the folder.

    Raises:
        InputError: Something did.
    """
    try:
        with np.errstate(all="ignore"):
            yield
    except DAMAGE as error:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise InputError(
            f"`{parameter}`: the files in {folder} contradict each other or were changed ({reason}); make the run again"
        ) from error


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind))


def _is_text(kind: pa.DataType) -> bool:
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def _check_texts(chunk: pa.Array, place: str) -> None:
    words = chunk.dictionary if pa.types.is_dictionary(chunk.type) else chunk
    longest = pa.compute.max(pa.compute.binary_length(words)).as_py() or 0
    if longest > LONGEST_TEXT:
        raise InputError(f"{place} holds a text of {longest} bytes; make the run again")
