"""Tables of the run folder as files, and their columns as arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.common.files import replacing
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
