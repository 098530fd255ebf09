"""The transfer study's folder: one table 'model x trained on x tested on', what it means, and the picture."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.study.targets import Target
from harness.study.transfer.figure import errors_figure
from harness.study.transfer.transfer import TransferResult
from harness.study.written import rounded, setting_line, target_lines

Row = Mapping[str, Any]
FIGURE = "transfer-errors.png"


def write_transfer(result: TransferResult, folder: Path) -> None:
    """Write ``results.json``, ``results.md`` and the picture into a folder, which is made if missing."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "results.json").write_text(json.dumps(as_json(result), indent=1) + "\n", encoding="utf-8")
    (folder / "results.md").write_text(as_markdown(result), encoding="utf-8")
    errors_figure(result.outcomes).savefig(folder / FIGURE, dpi=110)


def as_json(result: TransferResult) -> dict[str, Any]:
    """Return what ``--json`` prints."""
    return {
        "setting": dict(result.setting),
        "results": [rounded(row) for row in result.rows],
        "inputs": [rounded(row) for row in result.inputs],
        "targets": [vars(target) for target in result.targets],
    }


def as_markdown(result: TransferResult) -> str:
    """Return table, verdicts and ranges as Markdown."""
    return "\n".join(
        [
            "# Study: transfer",
            "",
            "Complete occlusion: the true state at the start, the true leader throughout, nothing measured. "
            "Mean absolute error of the longitudinal position, m, with 95 % intervals over vehicles.",
            "",
            setting_line(result.setting),
            "",
            *_table(result.rows),
            "",
            f"![errors]({FIGURE})",
            "",
            "## What was found",
            "",
            *summary_lines(result.targets),
            "",
            "## Every comparison",
            "",
            *target_lines(result.targets),
            "",
            "## Bias and coverage",
            "",
            "Mean of estimated minus true position, m; share of true positions inside the 95 % particle interval.",
            "",
            *_bias_table(result.rows),
            "",
            "## Inputs against the training range",
            "",
            "True situations of the test traffic (5 to 95 %), the range of `gmm`'s training data, the share beyond.",
            "",
            *_input_table(result.inputs),
            "",
        ]
    )


def summary_lines(targets: Sequence[Target]) -> list[str]:
    """Return one line for each test set and model that was trained on simulated traffic: whom it loses to, and when."""
    lost: dict[str, list[str]] = {}
    for target in targets:
        own, _, rival = target.text.partition(" below ")
        lost.setdefault(own, [])
        if not target.met:
            unclear = ", not clear" if target.measured.endswith("not clear") else ""
            name, _, when = rival.rpartition(" at ")
            lost[own].append(f"{name} at {when}{unclear}")
    return [f"- {own} " + (f"LOSES to {'; '.join(to)}" if to else "loses to none") + "." for own, to in lost.items()]


def _table(rows: Sequence[Row]) -> list[str]:
    heads = list(dict.fromkeys((row["tested_on"], row["horizon_s"]) for row in rows))
    lines = [_line(["model", "trained on", *(f"{tested_on}, {horizon:g} s" for tested_on, horizon in heads)])]
    lines.append("|---" * (len(heads) + 2) + "|")
    for (model, trained_on), cells in _by_model(rows).items():
        lines.append(_line([model, trained_on, *(_error(cells[head]) for head in heads)]))
    return lines


def _bias_table(rows: Sequence[Row]) -> list[str]:
    heads = [head for head in dict.fromkeys((row["tested_on"], row["horizon_s"]) for row in rows) if head[1] >= 5.0]
    lines = [_line(["model", "trained on", *(f"{tested_on}, {horizon:g} s" for tested_on, horizon in heads)])]
    lines.append("|---" * (len(heads) + 2) + "|")
    for (model, trained_on), cells in _by_model(rows).items():
        words = [f"{cells[head]['lon_bias_m']:+.2f}; {100 * cells[head]['coverage95_lon_m']:.0f} %" for head in heads]
        lines.append(_line([model, trained_on, *words]))
    return lines


def _input_table(inputs: Sequence[Row]) -> list[str]:
    lines = [_line(["tested on", "trained on", "input", "test traffic", "std", "training range", "outside"])]
    lines.append("|---" * 7 + "|")
    for row in inputs:
        spread = f"{row['from_5_percent']:.2f} to {row['to_95_percent']:.2f}"
        trained = f"{row['trained_from']:.2f} to {row['trained_to']:.2f}"
        words = [row["tested_on"], row["trained_on"], row["input"], spread, f"{row['std']:.2f}", trained]
        lines.append(_line([*words, f"{row['outside_percent']:.1f} %"]))
    return lines


def _by_model(rows: Sequence[Row]) -> dict[tuple[str, str], dict[tuple[str, float], Row]]:
    found: dict[tuple[str, str], dict[tuple[str, float], Row]] = {}
    for row in rows:
        found.setdefault((row["model"], row["trained_on"]), {})[row["tested_on"], row["horizon_s"]] = row
    return found


def _error(row: Row) -> str:
    low, high = row["lon_m_ci95"]
    return f"{row['lon_m']:.2f} [{low:.2f}, {high:.2f}]"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"
