"""Tables of a run folder that are written as the run goes on, so that a long run needs no more memory than a short one."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.runfolder.tables import as_arrow


class GrowingTables:
    """The tables of a folder that get the rows of one stretch after another, each stretch a row group.

    A table of a single stretch has the bytes that ``write_table`` gives it. No table can be read before ``close``.
    """

    def __init__(self, folder: Path) -> None:
        """Begin without a table; a table's file appears with its first rows."""
        self._folder = folder
        self._writers: dict[str, pq.ParquetWriter] = {}
        self._stretch: dict[str, int] = {}

    def append(self, stretch: int, tables: Mapping[str, pd.DataFrame]) -> None:
        """Add the rows of a stretch, whose number is above those before, to tables named by their files.

        A table that has the stretch's rows already, since an error came between two tables, does not get them again.
        """
        for name, table in tables.items():
            if self._stretch.get(name, -1) >= stretch:
                continue
            rows = as_arrow(table)
            if name not in self._writers:
                self._writers[name] = pq.ParquetWriter(self._folder / name, rows.schema, compression="zstd")
            # A column may look like whole numbers in one stretch and not in another.
            self._writers[name].write_table(rows.cast(self._writers[name].schema))
            self._stretch[name] = stretch

    def close(self) -> None:
        """Finish the tables; harmless to call twice."""
        for writer in self._writers.values():
            writer.close()

    def abandon(self) -> None:
        """Let go of the files, whether or not the tables in them can be finished."""
        for writer in self._writers.values():
            try:
                writer.close()
            except (OSError, pa.ArrowException):
                # On a full disk not even the end of a table can be written; nobody must try again.
                writer.is_open = False

    def drop(self, names: Collection[str]) -> None:
        """Remove tables that are of no use before all stretches are in them."""
        for name in names:
            writer = self._writers.pop(name, None)
            if writer is not None:
                writer.close()
                (self._folder / name).unlink(missing_ok=True)


def sampled_rows(path: Path, most_rows: int) -> pd.DataFrame:
    """Return the rows of a table: all, or, of a long one, those of every second, third, ... step.

    Args:
        path: The table's file; it has a column ``step``.
        most_rows: About how many rows there are at most.
    """
    with pq.ParquetFile(path) as file:
        stride = 1 + file.metadata.num_rows // most_rows
        pieces = [_every(file.read_row_group(group), stride) for group in range(file.num_row_groups)]
        table: pd.DataFrame = pa.concat_tables(pieces or [file.schema_arrow.empty_table()]).to_pandas()
    return table


def _every(rows: pa.Table, stride: int) -> pa.Table:
    return rows if stride == 1 else rows.filter(pa.array(rows["step"].to_numpy() % stride == 0))
