"""The tables of the page as HTML: errors, scores, and how long each vehicle was seen and how well it was tracked."""

from collections.abc import Mapping, Sequence
from itertools import islice
from typing import Any
from urllib.parse import quote

import numpy as np
import pandas as pd
from markupsafe import Markup, escape

from harness.common.error_text import shown
from harness.common.numbers import number
from harness.report.summary import (
    MAE_COLUMNS,
    SCORE_HEADINGS,
    VISIBILITY_ROWS,
    followed,
    mot_columns,
    mot_value,
    other_scores,
    own_scores,
)
from harness.scoring.evidence.rules import FOLLOW_CUTOFF_M
from harness.scoring.metrics import registry
from harness.storage.grid_folder import flattened
from harness.storage.tables import floats

MOST_ROWS = 300
NO_METRICS = {"run", "timing", "traffic", "recording", "nuscenes", "episode", "drive"}
"""Tables of ``metrics.json`` that no metric has made."""
MOT_ROWS = (("mot", "in sight"), ("mot_all", "detected in the last 10 s"))


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


def below(*texts: str) -> Markup:
    """Return what stands in small letters below a cell's value: a line for each text that is not empty."""
    small = Markup("<br><span class='interval-cell'>{}</span>")
    return Markup("").join(small.format(text) for text in texts if text)


def error_table(mae: Mapping[str, Any]) -> Markup:
    """Return the mean errors by visibility with their intervals and the share of vehicle-steps that they are over."""
    columns = (("position_m", "position, m"), *MAE_COLUMNS)
    rows = [
        [name, *(_with_interval(mae[state], key) for key, _ in columns), followed(mae[state])]
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
        if row.get("hidden_n") != 0
    ]
    fates = ("own track", "track lost", "track on another", "never had one")
    return html_table(["not detected for", "lon, m", "lat, m", "speed, m/s", *fates, "vehicle-steps"], rows)


def mot_table(metrics: Mapping[str, Any]) -> Markup:
    """Return the multi-object scores of both sets of vehicles, and other scores that metrics want shown."""
    columns = mot_columns()
    rows = [[name, *(mot_value(metrics, key, column) for column in columns)] for key, name in MOT_ROWS]
    table = html_table(["vehicles", *(column.heading for column in columns)], rows)
    next_box = Markup("</div>\n<div class='scroll'>")
    return table + next_box + html_table(SCORE_HEADINGS, other_scores(metrics))


def own_table(metrics: Mapping[str, Any]) -> Markup | None:
    """Return the scores of the user's own metrics; None without any."""
    own = [*own_scores(metrics), *_unknown_scores(metrics)]
    return html_table(SCORE_HEADINGS, own) if own else None


def _unknown_scores(metrics: Mapping[str, Any]) -> list[list[str]]:
    """Return a row for each number of metrics whose module is not imported, with its key in place of its name."""
    known = {*registry.METRICS, *NO_METRICS}
    own = flattened({name: table for name, table in metrics.items() if name not in known})
    return [
        [key, f"{value:.4g}" if isinstance(value, float) else shown(value, 20), "", ""]
        for key, value in islice(own.items(), MOST_ROWS)
        if isinstance(value, int | float)
    ]


def _with_interval(row: Mapping[str, Any], key: str) -> Markup:
    value, interval = row.get(key), row.get(f"{key}_ci95")
    lacking = "" if value is None else "too few vehicles"
    return escape(number(value, 2)) + below(f"{interval[0]:.2f} to {interval[1]:.2f}" if interval else lacking)


HIDDEN = "hidden"
HEADINGS = (
    *("vehicle", "not hidden, s", "hidden, s", "followed while not hidden, %", "error while not hidden, m"),
    *("own track while hidden, %", "error while hidden, m", "hidden cost by identity, m", "lost when detected again"),
)


def vehicle_table(errors: pd.DataFrame, events: pd.DataFrame, step_s: float) -> tuple[Markup, int] | None:
    """Return the vehicles of ``errors.parquet``, the costliest first, and how many are left out; None if there is none.

    Names lead to their worst moments in the replay; failures are counted from the rows of ``events.parquet``.
    """
    if not len(errors):
        return None
    failures = events.loc[events["outcome"].isin(["lost", "hijacked"]), "vehicle_id"].astype(object).value_counts()
    rows = [
        (of_vehicle["cost_m"].sum(), [*_vehicle_cells(str(name), of_vehicle, step_s), str(failures.get(name, 0))])
        for name, of_vehicle in _steps(errors).groupby("vehicle", sort=False)
    ]
    rows.sort(key=lambda row: -row[0])
    table = html_table(HEADINGS, [cells for _, cells in rows[:MOST_ROWS]])
    return table, max(0, len(rows) - MOST_ROWS)


def _steps(errors: pd.DataFrame) -> pd.DataFrame:
    """Return each vehicle-step with the distance of its own track, nan without one, and its hidden cost."""
    tracked = (errors["outcome"].astype(object) == "tracked").to_numpy()
    hidden = (errors["state"].astype(object) == HIDDEN).to_numpy()
    off_m = np.where(tracked, np.hypot(floats(errors, "lon_error_m"), floats(errors, "lat_error_m")), np.nan)
    cost_m = np.where(hidden, np.fmin(off_m, FOLLOW_CUTOFF_M), 0.0)
    columns = {"vehicle": errors["vehicle_id"].astype(object), "time_s": floats(errors, "time_s")}
    return pd.DataFrame({**columns, "hidden": hidden, "off_m": off_m, "cost_m": cost_m})


def _vehicle_cells(name: str, steps: pd.DataFrame, step_s: float) -> list[str | Markup]:
    """Return the cells of a vehicle up to its cost, the first of which leads to its worst moment."""
    hidden, seen = steps[steps["hidden"]], steps[~steps["hidden"]]
    # The worst is where it first costs most; of a vehicle that was never hidden, where it is farthest off.
    worst = int(np.argmax(steps["cost_m"] if len(hidden) else steps["off_m"].fillna(0.0)))
    address = f"#t={steps['time_s'].iloc[worst]:.1f}&vehicle={quote(name)}"
    link = Markup("<a href='{}'>{}</a>").format(address, name)
    times_s = [f"{step_s * len(part):.1f}" for part in (seen, hidden)]
    off = [(number(100.0 * part.off_m.notna().mean(), 0), number(part.off_m.mean(), 2)) for part in (seen, hidden)]
    return [link, *times_s, *off[0], *off[1], number(hidden["cost_m"].mean(), 2)]
