"""A study's folder: results as JSON and as a table for people, and the pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.study.figures import draw_study
from harness.study.study import StudyResult
from harness.study.targets import Target

Row = Mapping[str, Any]


def write_study(result: StudyResult, targets: Sequence[Target], setting: Mapping[str, Any], folder: Path) -> None:
    """Write ``results.json``, ``results.md`` and the pictures.

    Args:
        result: The study's numbers.
        targets: What was aimed at.
        setting: How the study was made: seeds, cases, particles, noise.
        folder: Where to; made if missing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    text = json.dumps(as_json(result, targets, setting), indent=1)
    (folder / "results.json").write_text(text + "\n", encoding="utf-8")
    (folder / "results.md").write_text(as_markdown(result, targets, setting), encoding="utf-8")
    draw_study(result, folder)


def as_json(result: StudyResult, targets: Sequence[Target], setting: Mapping[str, Any]) -> dict[str, Any]:
    """Return what ``results.json`` holds."""
    return {
        "setting": dict(setting),
        "results": [rounded(row) for row in result.rows],
        "targets": [vars(target) for target in targets],
    }


def as_markdown(result: StudyResult, targets: Sequence[Target], setting: Mapping[str, Any]) -> str:
    """Return the tables and the verdicts as Markdown."""
    parts = [f"# Study: {result.study}", "", setting_line(setting), ""]
    for occlusion in result.occlusions():
        rows = [row for row in result.rows if row["occlusion"] == occlusion]
        parts += [f"## {occlusion.capitalize()} occlusion", "", *_table(rows, result.study == "lane-change"), ""]
        parts += [f"![errors]({result.study}-{occlusion}-errors.png)", ""]
        parts += [f"![particles]({result.study}-{occlusion}-particles.png)", ""]
    return "\n".join([*parts, "## Targets", "", *target_lines(targets), ""])


def target_lines(targets: Sequence[Target]) -> list[str]:
    """Return one line for each target, the missed ones first and marked so."""
    ordered = sorted(targets, key=lambda target: target.met)
    return [f"- {'met' if target.met else 'MISSED'}: {target.text}: {target.measured}" for target in ordered]


def setting_line(setting: Mapping[str, Any]) -> str:
    """Return the setting in one sentence."""
    return "; ".join(f"{name.replace('_', ' ')}: {_plain(value)}" for name, value in setting.items()) + "."


def _plain(value: object) -> str:
    if isinstance(value, Mapping):
        return ", ".join(f"{name} {part}" for name, part in value.items())
    return ", ".join(f"{part:g}" for part in value) if isinstance(value, list) else str(value)


def _table(rows: Sequence[Row], lateral: bool) -> list[str]:
    horizons = list(dict.fromkeys(row["horizon_s"] for row in rows))
    models = list(dict.fromkeys(row["model"] for row in rows))
    by_key = {(row["model"], row["horizon_s"]): row for row in rows}
    quantities = {"lon_m": "position, m", "speed_mps": "speed, m/s"}
    if lateral:
        quantities |= {"lat_m": "lateral position, m", "lat_speed_mps": "lateral speed, m/s"}
    lines: list[str] = []
    for quantity, label in quantities.items():
        heads = ["mean" if horizon is None else f"{horizon:g} s" for horizon in horizons]
        lines += [f"| MAE of {label} | " + " | ".join(heads) + " |", "|---" * (len(heads) + 1) + "|"]
        for model in models:
            cells = [_cell(by_key[model, horizon], quantity) for horizon in horizons]
            lines.append(f"| {_named(by_key[model, horizons[0]])} | " + " | ".join(cells) + " |")
        lines.append("")
    heads = ["mean" if horizon is None else f"{horizon:g} s" for horizon in horizons]
    lines += ["| position: coverage of the 95 % interval; CRPS, m | " + " | ".join(heads) + " |"]
    lines.append("|---" * (len(heads) + 1) + "|")
    for model in models:
        cells = [_sharpness(by_key[model, horizon]) for horizon in horizons]
        lines.append(f"| {_named(by_key[model, horizons[0]])} | " + " | ".join(cells) + " |")
    return lines


def _named(row: Row) -> str:
    return row["model"] if row["label"] == "rival" else f"**{row['model']}** ({row['label']})"


def _cell(row: Row, quantity: str) -> str:
    low, high = row[f"{quantity}_ci95"]
    return f"{row[quantity]:.2f} [{low:.2f}, {high:.2f}]"


def _sharpness(row: Row) -> str:
    return f"{100 * row['coverage95_lon_m']:.0f} %; {row['crps_lon_m']:.2f}"


def rounded(row: Row) -> dict[str, Any]:
    """Return a row with its numbers rounded to 1e-5."""
    return {name: _round(value) for name, value in row.items()}


def _round(value: Any) -> Any:  # noqa: ANN401  a row's values are numbers, texts or lists of numbers
    if isinstance(value, float):
        return round(value, 5)
    if isinstance(value, list):
        return [_round(entry) for entry in value]
    return value
