"""Every table of a run as comma-separated values, under the names and columns of the run folder."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
from pyarrow import csv

from harness.report.finished import RecordedRun

TABLES = ("truth", "detections", "tracks", "errors", "events")


def export(run: RecordedRun, folder: Path) -> list[Path]:
    """Write ``truth.csv`` and so on; numbers in full precision, what is missing as an empty field."""
    files = []
    for name in TABLES:
        files.append(folder / f"{name}.csv")
        csv.write_csv(pa.Table.from_pandas(getattr(run, name), preserve_index=False), files[-1])
    return files
