"""Ratio of each tracker's hidden error to that of constant velocity, on common vehicle-steps.

Trackers that let go of different vehicles have mean errors over different vehicle-steps. Against one reference, on the
steps that tracker and reference both follow, their errors can be set beside each other.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from harness.scoring.metrics.quantity import Quantity
from harness.storage.grid_rows import column_of

if TYPE_CHECKING:
    import pandas as pd


COASTING_TRACKER = "oracle-kalman"
PREFIX = "against_coasting."
HIDDEN, TWO_TO_THREE_S = "hidden", "by_seconds_hidden.2"
OWN, COASTING, STEPS = (f"{PREFIX}{HIDDEN}.{name}" for name in ("lon_m", "coasting_lon_m", "n"))
RATIO, TOTAL = "ratio", "coasting_total_m"
QUANTITIES = (
    Quantity(OWN, "MAE hidden where constant velocity follows too, m", decimals=2, weight=STEPS),
    Quantity(COASTING, "MAE of constant velocity there, m", decimals=2, weight=STEPS),
    *(
        Quantity(
            f"{PREFIX}{part}.{RATIO}",
            f"{name} to that of constant velocity",
            decimals=2,
            weight=f"{PREFIX}{part}.{TOTAL}",
        )
        for part, name in ((HIDDEN, "ratio"), (TWO_TO_THREE_S, "ratio, hidden 2-3 s,"))
    ),
)


def with_ratios(runs: pd.DataFrame) -> pd.DataFrame:
    """Return the runs with each one's ratio to coasting, and coasting's summed error that ratios are weighed by.

    So weighed, the mean of the ratios over runs is the ratio of all errors together.
    """
    columns = {}
    for part in (HIDDEN, TWO_TO_THREE_S):
        own, coasting, n = (column_of(runs, f"{PREFIX}{part}.{name}") for name in ("lon_m", "coasting_lon_m", "n"))
        columns[f"{PREFIX}{part}.{RATIO}"] = own / coasting
        columns[f"{PREFIX}{part}.{TOTAL}"] = coasting * n
    return runs.assign(**columns)
