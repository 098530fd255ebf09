"""Tables of the run folder as files, and their columns as arrays."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.common.files import replacing
from harness.storage.schema import SCHEMA_VERSION, VERSION_KEY
from mmpf.numerics.arrays import FloatArray


def write_table(table: pd.DataFrame, path: Path) -> None:
    """Write a table as parquet; the same table gives the same bytes."""
    columns = {name: _arrow_column(table[name].to_numpy()) for name in table}
    with replacing(path) as temporary:
        pq.write_table(pa.table(columns, metadata={VERSION_KEY: str(SCHEMA_VERSION)}), temporary, compression="zstd")


def _arrow_column(values: npt.NDArray[np.generic]) -> pa.Array:
    # An empty column of names would otherwise have no type.
    return pa.array(values, type=pa.string() if values.dtype == object else None)


def floats(table: pd.DataFrame, column: str) -> FloatArray:
    """Return a column of numbers."""
    return table[column].to_numpy(dtype=np.float64)
