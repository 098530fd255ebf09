"""Tables of the run folder as files, written at once or while the run goes on, and their columns as arrays."""

import os
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.common.files import replacing, temporary_of
from harness.storage.schema import SCHEMA_VERSION, VERSION_KEY
from mmpf.numerics.arrays import FloatArray


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table as parquet; the same table gives the same bytes."""
    arrays = {name: table[name].to_numpy() for name in table}
    # An empty column of names would otherwise have no type.
    columns = {name: pa.array(each, pa.string() if each.dtype == object else None) for name, each in arrays.items()}
    # Room that is kept under the temporary name is written over, never given back before.
    with replacing(path) as temporary, temporary.open("r+b" if temporary.exists() else "wb") as file:
        pq.write_table(pa.table(columns, metadata={VERSION_KEY: str(SCHEMA_VERSION)}), file, compression="zstd")
        file.truncate()


def floats(table: pd.DataFrame, column: str) -> FloatArray:
    """Return a column of numbers."""
    return table[column].to_numpy(dtype=np.float64)


def rows_of_steps(table: pd.DataFrame) -> dict[int, slice]:
    """Return which rows are of each step, in the order of time, in which the rows must be."""
    steps, first = np.unique(table["step"].to_numpy(dtype=np.int64), return_index=True)
    ends = np.append(first[1:], len(table))
    return {int(step): slice(int(begin), int(end)) for step, begin, end in zip(steps, first, ends, strict=True)}


OVERHEAD_BYTES = 1 << 14
"""What a file takes beside its rows."""


class GrowingTables:
    """The tables of a folder that get the rows of one stretch after another.

    The first stretch is the table as ``write_table`` leaves it. Each later one lies beside it, whole or not at all,
    until ``close`` puts them together; in the finished table each stretch is a row group.
    """

    def __init__(self, folder: Path) -> None:
        """Begin without a table; a table's file appears with its first rows."""
        self._folder = folder
        self._parts: dict[str, list[Path]] = {}
        self._stretches: dict[str, list[int]] = {}

    def keep_room(self, size_bytes: Mapping[str, int]) -> None:
        """Keep room for rows of tables that are still in memory, so that a full disk shows while they can be written.

        Raises:
            OSError: There is no room; that which was kept stays.
        """
        for name, size in size_bytes.items():
            with temporary_of(self._next(name)).open("ab") as file:
                # From the end on, since a file system without reservations writes the whole range.
                kept = min(file.tell(), OVERHEAD_BYTES + size - 1)
                os.posix_fallocate(file.fileno(), kept, OVERHEAD_BYTES + size - kept)

    def append(self, stretch: int, tables: Mapping[str, pd.DataFrame]) -> None:
        """Add the rows of a stretch, whose number is above those before, to tables named by their files.

        A table that has the stretch's rows already, since an error came between two tables, does not get them again.
        """
        for name, table in tables.items():
            parts, stretches = self._parts.setdefault(name, []), self._stretches.setdefault(name, [])
            if stretch in stretches:
                continue
            path = self._next(name)
            write_table(table, path)
            parts.append(path)
            stretches.append(stretch)

    def _next(self, name: str) -> Path:
        parts = len(self._parts.get(name, ()))
        return self._folder / (f"{Path(name).stem}-{parts + 1}{Path(name).suffix}" if parts else name)

    def take_back(self, stretch: int) -> None:
        """Remove the rows of the last stretch from those tables that have them; it is not the first."""
        for name, stretches in self._stretches.items():
            if stretches and stretches[-1] == stretch:
                stretches.pop()
                self._parts[name].pop().unlink()

    def close(self) -> None:
        """Finish the tables, the smallest first, since each that is done makes room for the next; harmless twice.

        Raises:
            OSError: There is no room; no row is lost, and it may be called again.
        """
        for name in sorted(self._parts, key=lambda name: sum(part.stat().st_size for part in self._parts[name])):
            parts = self._parts[name]
            if len(parts) > 1:
                _put_together(parts, self._folder / name)
                for part in parts[1:]:
                    part.unlink()
                del parts[1:]

    def drop(self, names: Collection[str]) -> None:
        """Remove tables that are of no use before all stretches are in them."""
        for name in names:
            for part in self._parts.pop(name, []):
                part.unlink()


def _put_together(parts: Sequence[Path], final: Path) -> None:
    # A column may look like whole numbers in one stretch and not in another.
    schema = pa.unify_schemas([pq.read_schema(part) for part in parts], promote_options="permissive")
    with replacing(final) as temporary, pq.ParquetWriter(temporary, schema, compression="zstd") as writer:
        for part in parts:
            rows = pa.concat_tables([schema.empty_table(), pq.read_table(part)], promote_options="permissive")
            writer.write_table(rows)


def sampled_rows(path: Path, most_rows: int) -> pd.DataFrame:
    """Return the rows of a table: all, or, of a long one, about so many: those of every second, third, ... step."""
    with pq.ParquetFile(path) as file:
        stride = 1 + file.metadata.num_rows // most_rows
        groups = (file.read_row_group(group) for group in range(file.num_row_groups))
        pieces = [rows.filter(pa.array(rows["step"].to_numpy() % stride == 0)) for rows in groups]
        table: pd.DataFrame = pa.concat_tables(pieces or [file.schema_arrow.empty_table()]).to_pandas()
    return table
