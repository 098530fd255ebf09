"""The tables of the page as HTML."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from markupsafe import Markup, escape

from harness.report.summary import MAE_COLUMNS, VISIBILITY_ROWS, mot_columns, mot_value, other_scores
from harness.report.summary_text import number
from harness.scoring.metrics.quantity import Quantity

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
            *(_mean(mae[state], key) for key, _ in columns),
            number(mae[state].get("followed_percent"), 0, " %"),
            _count(mae[state].get("n")),
        ]
        for state, name in VISIBILITY_ROWS
    ]
    return html_table(["vehicles", *(heading for _, heading in columns), "followed", "steps followed"], rows)


def hidden_table(mae: Mapping[str, Any]) -> Markup:
    """Return the errors and fates of hidden vehicles by the time since their last detection."""
    rows = [
        [
            f"{row['from_s']:g} to {row['to_s']:g} s",
            *(_mean(row, key) for key in ("lon_m", "lat_m", "speed_mps")),
            *(number(row.get(f"{fate}_percent"), 0, " %") for fate in ("tracked", "lost", "hijacked", "untracked")),
            _count(row.get("hidden_n")),
        ]
        for row in mae["by_seconds_hidden"]
    ]
    fates = ("own track", "track lost", "track on another", "never had one")
    return html_table(["unseen for", "lon m", "lat m", "speed m/s", *fates, "steps, all"], rows)


def mot_table(metrics: Mapping[str, Any]) -> Markup:
    """Return the multi-object scores of both sets of vehicles, and other scores that metrics want shown."""
    columns = mot_columns()

    def cell(key: str, column: Quantity) -> str:
        value = mot_value(metrics, key, column)
        return number(value, column.decimals) if column.decimals else _count(value)

    rows = [[name, *(cell(key, column) for column in columns)] for key, name in MOT_ROWS]
    table, others = html_table(["vehicles", *(column.heading for column in columns)], rows), other_scores(metrics)
    return table + html_table(["score", "value"], others) if others else table


def _mean(row: Mapping[str, Any], key: str) -> Markup:
    value, interval = row.get(key), row.get(f"{key}_ci95")
    if value is None:
        return Markup("-")
    if interval is None:
        return escape(f"{value:.2f}")
    low, high = interval
    return Markup("{}<br><span class='interval-cell'>{} to {}</span>").format(
        f"{value:.2f}", f"{low:.2f}", f"{high:.2f}"
    )


def _count(value: float | None) -> str:
    return "-" if value is None else f"{value:,.0f}".replace(",", "\u202f")
