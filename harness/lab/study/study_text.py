"""A study's results as JSON and as Markdown tables."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

from harness.common.markdown import PagePart, markdown_page, markdown_table
from harness.common.numbers import rounded
from harness.lab.study.study import StudyResult

Row = Mapping[str, Any]
DECIMALS = 5
QUANTITIES = {"lon_m": "position, m", "speed_mps": "speed, m/s"}
INTERVALS = "In brackets: 95 % intervals of mean errors over recordings, one for each density and seed of the traffic."
LATERAL_QUANTITIES = {"lat_m": "lateral position, m", "lat_speed_mps": "lateral speed, m/s"}


def as_json(rows: Sequence[Row], setting: Mapping[str, Any]) -> dict[str, Any]:
    """Return a study's setting and numbers, as ``results.json`` holds them and ``--json`` prints them."""
    return {"setting": dict(setting), "results": rounded(rows, DECIMALS)}


def as_markdown(result: StudyResult, setting: Mapping[str, Any]) -> str:
    """Return the tables as Markdown."""
    parts: list[PagePart] = [f"# Study: {result.study}", INTERVALS]
    for occlusion in result.occlusions():
        rows = [row for row in result.rows if row["occlusion"] == occlusion]
        parts += [f"## {occlusion.capitalize()} occlusion", sentence(rows)]
        parts += _tables(rows, result.study == "lane-change")
        parts += [f"![{kind}]({result.study}-{occlusion}-{kind}.png)" for kind in ("errors", "particles")]
    return markdown_page([*parts, "## Setting", setting_line(setting)])


def sentence(rows: Sequence[Row]) -> str:
    """Return in one sentence how far off each model is at the longest horizon, the closest first."""
    horizon_s = max(row["horizon_s"] for row in rows if row["horizon_s"] is not None)
    last = sorted((row for row in rows if row["horizon_s"] == horizon_s), key=lambda row: row["lon_m"])
    first, *others = (f"{row['model']} {row['lon_m']:.2f} m" for row in last)
    then = f", then {', '.join(others)}" if others else ""
    return f"After {horizon_s:g} s the mean error of the position along the road is smallest with {first}{then}."


def setting_line(setting: Mapping[str, Any]) -> str:
    """Return the setting in one sentence."""
    return "; ".join(f"{name.replace('_', ' ')}: {_plain(value)}" for name, value in setting.items()) + "."


def _plain(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {part}" for name, part in value.items())
    return ", ".join(f"{part:g}" for part in value) if isinstance(value, list) else str(value)


def _tables(rows: Sequence[Row], lateral: bool) -> list[list[str]]:
    by_key = {(row["model"], row["horizon_s"]): row for row in rows}
    horizons = list(dict.fromkeys(row["horizon_s"] for row in rows))
    heads = ["mean" if horizon is None else f"{horizon:g} s" for horizon in horizons]

    def table(heading: str, cell: Callable[[Row], str]) -> list[str]:
        labels = {row["model"]: row["label"] for row in rows}
        named = {model: model if label == "rival" else f"**{model}** ({label})" for model, label in labels.items()}
        lines = ([name, *(cell(by_key[model, horizon]) for horizon in horizons)] for model, name in named.items())
        return markdown_table([heading, *heads], lines)

    quantities = QUANTITIES | (LATERAL_QUANTITIES if lateral else {})
    errors = (table(f"MAE of {label}", partial(error_cell, quantity=name)) for name, label in quantities.items())
    heading = "position: coverage of the 95 % interval; CRPS, m"
    return [*errors, table(heading, lambda row: f"{100 * row['coverage95_lon_m']:.0f} %; {row['crps_lon_m']:.2f}")]


def error_cell(row: Row, quantity: str) -> str:
    """Return a row's mean error with its interval."""
    low, high = row[f"{quantity}_ci95"]
    return f"{row[quantity]:.2f}" if low is None else f"{row[quantity]:.2f} [{low:.2f}, {high:.2f}]"
