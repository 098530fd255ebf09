"""Reads tables of a run folder that may come from elsewhere: sizes first, from the file's own footer, then kinds."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.common.errors import InputError
from harness.common.untrusted_files import MB, MOST_TABLE_BYTES, check_file
from harness.storage.schema import SCHEMA_VERSION, VERSION_KEY, Column

MOST_ROWS, MOST_COLUMNS, MOST_CELLS = 60_000_000, 5_000, 1_500_000_000
LONGEST_TEXT = 2_000
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
        InputError: It is no ordinary file, is of a version to come, has too many rows or columns, or columns of another
            kind than numbers and texts.
    """
    check_file(path, MOST_TABLE_BYTES, parameter)
    footer = pq.read_metadata(path)
    _check_version(footer, f"`{parameter}`: {path}")
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


def check_kinds(table: pd.DataFrame, columns: Iterable[Column], place: str) -> None:
    """Refuse columns that do not hold what they are declared to.

    Args:
        table: The table.
        columns: Columns that it has.
        place: Where the table is, for the message.

    Raises:
        InputError: A column holds texts for numbers, numbers for texts, an unknown word, or a number that none can be.
    """
    for column in columns:
        values = table[column.name]
        place_of_column = f"{place}: {column.name}"
        if values.notna().any() and pd.api.types.is_numeric_dtype(values) == column.is_text:
            wanted = "texts" if column.is_text else "numbers"
            raise InputError(f"{place_of_column} holds no {wanted}; make the run again")
        unknown = sorted(set(map(str, values.unique())) - set(column.words)) if column.words else []
        if unknown:
            known = ", ".join(filter(None, column.words))
            raise InputError(f"{place_of_column} holds {unknown[0][:40]!r}; there are {known}")
        if column.below is None:
            continue
        # What is not finite is not below anything.
        numbers = values.to_numpy(dtype=np.float64)
        if not (np.abs(numbers) < column.below).all() or (column.positive and not (numbers > 0.0).all()):
            raise InputError(f"{place_of_column} holds a number that none can be; make the run again")


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


def _check_version(footer: pq.FileMetaData, place: str) -> None:
    """Refuse a table of a version to come; one without a version is of the first."""
    told = (footer.metadata or {}).get(VERSION_KEY.encode(), b"1")
    if not told.isdigit():
        raise InputError(f"{place} has a {VERSION_KEY} that is no number; make the run again")
    if int(told) > SCHEMA_VERSION:
        raise InputError(
            f"{place} has {VERSION_KEY} {told.decode()[:20]}, and this program reads up to {SCHEMA_VERSION}; install a "
            "newer one"
        )


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind))


def _is_text(kind: pa.DataType) -> bool:
    return bool(pa.types.is_string(kind) or pa.types.is_large_string(kind))


def _check_texts(chunk: pa.Array, place: str) -> None:
    words = chunk.dictionary if pa.types.is_dictionary(chunk.type) else chunk
    longest = pa.compute.max(pa.compute.binary_length(words)).as_py() or 0
    if longest > LONGEST_TEXT:
        raise InputError(f"{place} holds a text of {longest} bytes; make the run again")
