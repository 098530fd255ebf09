"""Reads tables of external run folders: unpacked in a child process, then checked."""

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from harness.common.bounds import Numbers, check_numbers
from harness.common.error_text import is_own_fault
from harness.common.errors import InputError
from harness.common.isolation import ProcessLimits, isolated
from harness.common.untrusted_files import check_file, reading
from harness.storage.schema import FLAG, SCHEMA_VERSION, VERSION_KEY, Column
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray

AGAIN = "make the run again"
READABLE = (
    *(pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_string, pa.types.is_large_string),
    pa.types.is_null,
)
NUMBER_BYTES = 8
DAMAGE = (ValueError, TypeError, LookupError, ArithmeticError, AttributeError, AssertionError)


def read_parquet(
    path: Path, parameter: str, wanted: pc.Expression | None = None, noted: int | None = None
) -> pd.DataFrame:
    """Return a table, which is unpacked in a process of its own.

    Args:
        parameter: Parameter that named it, for messages.
        wanted: Which rows, as an expression of PyArrow; only row groups that may hold some are unpacked. None for all.
        noted: How many rows the run has written; None if that is not known.

    Raises:
        InputError: It is not a regular file, damaged or too large, of a version to come, has columns of another kind
            than numbers and texts, or more or fewer rows than were written.
    """
    check_file(path, parameter)
    place = f"`{parameter}`: {path}"
    limits = ProcessLimits.for_files([path])
    # What this process gets it holds twice, as a table of each library.
    most_bytes = limits.memory_bytes - ProcessLimits.memory_bytes // 2
    work = partial(_table, path, place, wanted, noted, most_bytes)
    frame: pd.DataFrame = isolated(work, place, limits).to_pandas()
    return frame


def _table(path: Path, place: str, wanted: pc.Expression | None, noted: int | None, most_bytes: int) -> pa.Table:
    source = os.path.join(os.curdir, path)  # PyArrow takes a ~ that comes first for the user's own folder
    with reading(place, "table of a run"), pq.ParquetFile(source, pre_buffer=False) as file:
        footer, schema = file.metadata, file.schema_arrow
        # One without a version is of the first.
        version = (footer.metadata or {}).get(VERSION_KEY.encode(), b"1")
        if not version.isdigit() or int(version) > SCHEMA_VERSION:
            told = version[:20].decode(errors="replace")
            raise InputError(f"{place} has {VERSION_KEY} {told}, not 1 to {SCHEMA_VERSION}; install a newer program")
        if noted is not None and footer.num_rows != noted:
            raise InputError(
                f"{place} has {footer.num_rows} rows, the run wrote {str(noted)[:20]}; make the run again, or take "
                "rows out of manifest.json if you meant that"
            )
        for field in schema:
            kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
            if not any(is_kind(kind) for is_kind in READABLE):
                raise InputError(f"{place}: {field.name[:60]} holds {str(kind)[:60]}; make the run again")
        packed = sum(footer.row_group(group).total_byte_size for group in range(footer.num_row_groups))
        if NUMBER_BYTES * footer.num_rows * footer.num_columns + packed > most_bytes:
            raise MemoryError
        if wanted is not None:
            return pq.read_table(source, use_threads=False, pre_buffer=False, filters=wanted)
        return file.read(use_threads=False)


def check_kinds(table: pd.DataFrame, columns: Iterable[Column], place: str) -> None:
    """Refuse columns that do not hold what they are declared to.

    Raises:
        InputError: A column holds texts for numbers, numbers for texts, an unknown word, or a number that none can be.
    """
    for column in columns:
        values = table[column.name]
        if values.notna().any() and pd.api.types.is_numeric_dtype(values) == column.is_text:
            wanted = "texts" if column.is_text else "numbers"
            raise InputError(f"{place}: {column.name} holds no {wanted}; {AGAIN}")
        unknown = sorted(set(map(str, values.unique())) - set(column.words)) if column.words else []
        if unknown:
            known = ", ".join(filter(None, column.words))
            raise InputError(f"{place}: {column.name} holds {unknown[0][:40]!r}; there are {known}")
        if column.named and values.isna().any():
            raise InputError(f"{place}: {column.name} is missing in a row; {AGAIN}")
        if (allowed := FLAG if column.type == "bool" else column.numbers) is not None:
            # A column of no row has any type.
            numbers: dict[str, FloatArray] = {column.name: values.to_numpy(dtype=np.float64)}
            check_numbers(place, numbers, {column.name: allowed}, fix=AGAIN)


def check_truth(truth: pd.DataFrame, road: Road, place: str) -> None:
    """Refuse a truth that no run on a road writes.

    Raises:
        InputError: It lacks steps, or holds lanes that the road has not.
    """
    steps = np.unique(truth["step"].to_numpy(dtype=np.int64))
    most = max((lane.number for lane in road.lanes), default=sum(1 for _ in road.lines()))
    if (np.diff(steps) > 1).any():
        raise InputError(f"{place} lacks steps; {AGAIN}")
    check_numbers(place, truth, {"lane": Numbers(0, most)}, fix=AGAIN)


def rows_of(folder: Path) -> dict[str, int]:
    """Return how many rows each table of a folder has, by file, for the manifest."""
    return {path.name: pq.read_metadata(path).num_rows for path in sorted(folder.glob("*.parquet"))}


@contextmanager
def sound_tables(folder: Path, parameter: str) -> Iterator[None]:
    """Turn what goes wrong over tables that contradict each other into one line that names the folder."""
    try:
        with np.errstate(all="ignore"):
            yield
    except DAMAGE as error:
        if is_own_fault(error):
            raise
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise InputError(
            f"`{parameter}`: the files in {folder} contradict each other or were changed ({reason}); make the run again"
        ) from error
