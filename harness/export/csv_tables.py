"""Every table of a run as CSV, with the names and columns of the run folder."""

import re
from pathlib import Path

import pyarrow as pa
from pandas.api.types import is_numeric_dtype
from pyarrow import csv

from harness.running.finished import RecordedRun
from harness.storage.run_folder import read_table

# A minus begins a formula too, unless a number follows it and nothing else.
FORMULA = re.compile(r"[=+@\t\r]|-(?![\d.]+$)")


def export(run: RecordedRun, folder: Path) -> list[Path]:
    """Write ``truth.csv`` and so on; numbers in full precision, what is missing as an empty field."""
    files = []

    def harmless(value: object) -> object:
        """Return a value that no spreadsheet takes for a formula: before a text that begins so is an apostrophe."""
        return f"'{value}" if isinstance(value, str) and FORMULA.match(value) else value

    for path in sorted(run.folder.glob("*.parquet")):
        files.append(folder / f"{path.stem}.csv")
        table = read_table(run.folder, path.name, "folder")
        texts = [name for name in table if not is_numeric_dtype(table[name])]
        table = table.assign(**{str(name): table[name].map(harmless) for name in texts})
        csv.write_csv(pa.Table.from_pandas(table, preserve_index=False), files[-1])
    return files
