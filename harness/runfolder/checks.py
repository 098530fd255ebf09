"""Reads tables of a run folder that may come from elsewhere: sizes first, from the file's own footer, then kinds."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.errors import InputError
from harness.inputs import MB, MOST_TABLE_BYTES, check_file

MOST_ROWS, MOST_COLUMNS, MOST_CELLS = 60_000_000, 5_000, 1_500_000_000
LONGEST_TEXT = 2_000
TEXTS = frozenset(
    {
        *("vehicle_id", "truth_id", "occluder_id", "state", "outcome", "label", "error"),
        *("net", "demand", "replay", "tracker", "variant", "model", "update"),
    }
)
DAMAGE = (ValueError, TypeError, LookupError, ArithmeticError, AttributeError, AssertionError)


def read_parquet(path: Path, parameter: str) -> pd.DataFrame:
    """Return a table after checking how much it holds; texts are unpacked only when their lengths are known.

    Raises:
        InputError: It is no ordinary file, has too many rows or columns, or columns of another kind than numbers and
            texts.
    """
    check_file(path, MOST_TABLE_BYTES, parameter)
    footer = pq.read_metadata(path)
    rows, columns = footer.num_rows, footer.num_columns
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
    table = pq.read_table(path, read_dictionary=texts)
    for name in texts:
        for chunk in table[name].chunks:
            _check_texts(chunk, f"`{parameter}`: {path}: {name[:60]}")
        place = table.schema.get_field_index(name)
        table = table.set_column(place, name, table[name].cast(pa.string()))
    if table.nbytes > MOST_TABLE_BYTES:
        raise InputError(f"`{parameter}`: {path} has {table.nbytes / MB:.0f} MB when unpacked; make a shorter run")
    frame: pd.DataFrame = table.to_pandas()
    return frame


def check_kinds(table: pd.DataFrame, columns: Collection[str], place: str) -> None:
    """Refuse columns that hold texts where numbers belong, or the other way round.

    Args:
        table: The table.
        columns: Columns that are needed.
        place: Where the table is, for the message.

    Raises:
        InputError: A column is of the wrong kind, or a step is no number.
    """
    for name in columns:
        numbers = pd.api.types.is_numeric_dtype(table[name])
        if table[name].notna().any() and numbers == (name in TEXTS):
            wanted = "texts" if name in TEXTS else "numbers"
            raise InputError(f"{place}: {name} holds no {wanted}; make the run again")
        if name in TEXTS or not len(table):
            continue
        if name in ("step", "episode") and not (
            np.isfinite(values := table[name].to_numpy(dtype=np.float64)).all() and (np.abs(values) < 1e9).all()
        ):
            raise InputError(f"{place}: {name} holds a number that none can be; make the run again")


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
