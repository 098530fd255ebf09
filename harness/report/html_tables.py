"""The tables of the page as HTML: errors, scores, and how long each vehicle was seen and how well it was tracked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

import numpy as np
import pandas as pd
from markupsafe import Markup, escape

from harness.report.summary import MAE_COLUMNS, VISIBILITY_ROWS, mot_columns, mot_value, other_scores
from harness.report.summary_text import number, out_of
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M
from harness.storage.tables import floats
from mmpf.numerics.arrays import BoolArray, FloatArray

MOT_ROWS = (("mot", "in sight"), ("mot_all", "seen in the last 10 s"))
POSITION_COLUMN = ("position_m", "position m")


def html_table(headings: Sequence[str | Markup], rows: Sequence[Sequence[str | Markup]]) -> Markup:
    """Return a table whose rows begin with their name; plain text is escaped."""
    head = Markup("").join(Markup("<th scope='col'>{}</th>").format(heading) for heading in headings)
    body = Markup("").join(
        Markup("<tr><th scope='row'>{}</th>{}</tr>").format(
            row[0], Markup("").join(Markup("<td>{}</td>").format(cell) for cell in row[1:])
        )
        for row in rows
    )
    return Markup("<table><thead><tr>{}</tr></thead><tbody>{}</tbody></table>").format(head, body)


def error_table(mae: Mapping[str, Any]) -> Markup:
    """Return the mean errors by visibility with their intervals and the share of vehicle-steps that they are over."""
    columns = (POSITION_COLUMN, *MAE_COLUMNS)
    rows = [
        [
            name,
            *(_with_interval(mae[state], key) for key, _ in columns),
            out_of(number(mae[state].get("followed_percent"), 0, " %"), mae[state].get("of_n")),
        ]
        for state, name in VISIBILITY_ROWS
    ]
    return html_table(["vehicles", *(heading for _, heading in columns), "followed"], rows)


def hidden_table(mae: Mapping[str, Any]) -> Markup:
    """Return the errors and fates of hidden vehicles by the time since their last detection."""
    rows = [
        [
            f"{row['from_s']:g} to {row['to_s']:g} s",
            *(_with_interval(row, key) for key in ("lon_m", "lat_m", "speed_mps")),
            *(number(row.get(f"{fate}_percent"), 0, " %") for fate in ("tracked", "lost", "hijacked", "untracked")),
            number(row.get("hidden_n"), 0),
        ]
        for row in mae["by_seconds_hidden"]
    ]
    fates = ("own track", "track lost", "track on another", "never had one")
    return html_table(["unseen for", "lon m", "lat m", "speed m/s", *fates, "vehicle-steps"], rows)


def mot_table(metrics: Mapping[str, Any]) -> Markup:
    """Return the multi-object scores of both sets of vehicles, and other scores that metrics want shown."""
    columns = mot_columns()
    rows = [[name, *(mot_value(metrics, key, column) for column in columns)] for key, name in MOT_ROWS]
    table, others = html_table(["vehicles", *(column.heading for column in columns)], rows), other_scores(metrics)
    return table + html_table(["score", "value", "better", "samples"], others) if others else table


def _with_interval(row: Mapping[str, Any], key: str) -> Markup:
    value, interval = row.get(key), row.get(f"{key}_ci95")
    if value is None:
        return Markup("-")
    if interval is None:
        return escape(f"{value:.2f}")
    low, high = interval
    return Markup("{}<br><span class='interval-cell'>{} to {}</span>").format(
        f"{value:.2f}", f"{low:.2f}", f"{high:.2f}"
    )


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
