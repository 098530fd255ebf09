"""Errors of two trackers on the same vehicles at the same steps."""

import pandas as pd

KEYS = ["episode", "step", "vehicle_id"]
QUANTITIES = ["lon_error_m", "lat_error_m", "speed_error_mps", "lat_speed_error_mps"]


def paired_errors(first: pd.DataFrame, second: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of two error tables of one truth on which both trackers follow the vehicle.

    A tracker that lets go of difficult vehicles must not look better for it; on these rows both had to answer. Columns
    are episode, step, vehicle_id, state, seconds_hidden and each error twice, suffixed ``_a`` and ``_b``.
    """
    a = first.loc[first["outcome"] == "tracked", [*KEYS, "state", "seconds_hidden", *QUANTITIES]]
    b = second.loc[second["outcome"] == "tracked", [*KEYS, *QUANTITIES]]
    return a.merge(b, on=KEYS, suffixes=("_a", "_b"))
