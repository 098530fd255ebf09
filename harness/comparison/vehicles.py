"""Pairs two single runs on the same traffic vehicle by vehicle."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harness.comparison.sources import Source
from harness.comparison.verdicts import Arms, compared_quantities
from harness.errors import InputError
from harness.grid.rows import column_of
from harness.runfolder import folder as runfolder
from harness.scoring.paired import KEYS, QUANTITIES, paired_errors
from harness.scoring.quantity import Quantity
from mmpf.compute.arrays import FloatArray

if TYPE_CHECKING:
    import pandas as pd


ERROR_COLUMNS = {"lon_m": "lon_error_m", "lat_m": "lat_error_m", "speed_mps": "speed_error_mps"}


def arms_by_vehicle(a: Source, b: Source) -> list[Arms]:
    """Return the mean absolute errors of each vehicle in both runs, over the steps at which both follow it.

    Scores of a whole run, which no vehicle has of its own, are given untested.

    Raises:
        InputError: The runs saw different traffic.
    """
    _check_same_traffic(a, b)
    columns = (*KEYS, *QUANTITIES, "state", "seconds_hidden", "outcome")
    first, second = (runfolder.read_table(side.folder, runfolder.ERRORS, "compare", columns) for side in (a, b))
    pairs = paired_errors(first, second)
    label = a.labels[0] if a.labels == b.labels else f"{a.labels[0]} to {b.labels[0]}"
    return [_of_vehicles(label, each, pairs) or _of_runs(label, each, a, b) for each in compared_quantities()]


def _check_same_traffic(a: Source, b: Source) -> None:
    places = ["step", "vehicle_id", "lon_m", "lat_m"]
    first, second = (runfolder.read_table(side.folder, runfolder.TRUTH, "compare", places)[places] for side in (a, b))
    if not first.equals(second):
        raise InputError(
            f"compare: {a.name} and {b.name} are single runs on different traffic, which tells nothing; make the "
            f"second with `replay` {a.folder}, or compare grids of several seeds"
        )


def _of_vehicles(label: str, quantity: Quantity, pairs: pd.DataFrame) -> Arms | None:
    table, state, *name = quantity.key.split(".")
    if table != "mae" or name[0] not in ERROR_COLUMNS:
        return None
    rows = pairs[pairs["state"] == state]
    vehicle = [rows["episode"], rows["vehicle_id"]]
    a, b = (_vehicle_means(rows[f"{ERROR_COLUMNS[name[0]]}_{side}"], vehicle) for side in ("a", "b"))
    return Arms(label, quantity, a, b)


def _vehicle_means(errors: pd.Series[float], vehicle: list[pd.Series[str]]) -> FloatArray:
    return np.asarray(errors.abs().groupby(vehicle).mean(), dtype=np.float64)


def _of_runs(label: str, quantity: Quantity, a: Source, b: Source) -> Arms:
    of_a, of_b = (column_of(side.rows, quantity.key) for side in (a, b))
    return Arms(label, quantity, of_a, of_b, testable=False)
