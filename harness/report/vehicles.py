"""The table of a run's vehicles: how long each was visible and hidden, and how well it was tracked."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import quote

import numpy as np
import pandas as pd
from markupsafe import Markup

from harness.report.html_tables import html_table
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M
from harness.storage.tables import floats
from mmpf.numerics.arrays import BoolArray, FloatArray

MOST_ROWS = 300
HIDDEN = "hidden"
HEADINGS = (
    "vehicle", "seen s", "hidden s", "followed in sight %", "error in sight m", "own track while hidden %",
    "error hidden m", "hidden cost by identity m", "lost when seen again",
)  # fmt: skip


@dataclass(frozen=True)
class VehicleTable:
    """The table of vehicles, the costliest first; names lead to their worst moments in the replay.

    ``cutoff_m`` is what a hidden vehicle costs whose own track does not follow it; ``left_out`` are not listed.
    """

    table: Markup
    left_out: int
    cutoff_m: float


def vehicle_table(errors: pd.DataFrame, events: pd.DataFrame, step_s: float) -> VehicleTable | None:
    """Return the table from the rows of ``errors.parquet`` and ``occlusions.parquet``; None if nobody was detected."""
    if not len(errors):
        return None
    distance_m = np.hypot(floats(errors, "lon_error_m"), floats(errors, "lat_error_m"))
    tracked = (errors["outcome"].astype(object) == "tracked").to_numpy()
    hidden = (errors["state"].astype(object) == HIDDEN).to_numpy()
    cost_m = np.where(hidden, np.where(tracked, np.minimum(distance_m, FOLLOW_CUTOFF_M), FOLLOW_CUTOFF_M), 0.0)
    bad = events[events["outcome"].astype(object).isin(["lost", "hijacked"])]
    failures = bad["vehicle_id"].astype(object).value_counts()
    times = floats(errors, "time_s")
    rows: list[tuple[float, list[str | Markup]]] = []
    for name, at in errors.groupby(errors["vehicle_id"].astype(object), sort=False).indices.items():
        own = _Own(tracked[at], hidden[at], distance_m[at], cost_m[at])
        moment_s = float(times[at[own.worst()]])
        address = f"#t={moment_s:.1f}&vehicle={quote(str(name))}"
        link = Markup("<a href='{}'>{}</a>").format(address, str(name))
        rows.append((float(own.cost_m.sum()), [link, *own.cells(step_s), str(int(failures.get(name, 0)))]))
    rows.sort(key=lambda row: -row[0])
    table = html_table(HEADINGS, [cells for _, cells in rows[:MOST_ROWS]])
    return VehicleTable(table, max(0, len(rows) - MOST_ROWS), FOLLOW_CUTOFF_M)


@dataclass(frozen=True)
class _Own:
    """The rows of one vehicle, arrays of shape (n,)."""

    tracked: BoolArray
    hidden: BoolArray
    distance_m: FloatArray
    cost_m: FloatArray

    def worst(self) -> int:
        """Return where it first costs most; of one that was never hidden, where it is farthest off."""
        if self.hidden.any():
            return int(np.argmax(self.cost_m))
        return int(np.argmax(np.nan_to_num(np.where(self.tracked, self.distance_m, 0.0))))

    def cells(self, step_s: float) -> list[str]:
        """Return its numbers as they stand in the table."""
        seen, percent = ~self.hidden, np.where(self.tracked, 100.0, 0.0)
        return [
            f"{step_s * seen.sum():.1f}", f"{step_s * self.hidden.sum():.1f}",
            _mean(percent[seen], 0), _mean(self.distance_m[seen & self.tracked], 2),
            _mean(percent[self.hidden], 0), _mean(self.distance_m[self.hidden & self.tracked], 2),
            _mean(self.cost_m[self.hidden], 2),
        ]  # fmt: skip


def _mean(values: FloatArray, decimals: int) -> str:
    return f"{values.mean():.{decimals}f}" if len(values) else "-"
