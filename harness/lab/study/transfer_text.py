"""The transfer study's folder: a table of model x training x test traffic, and the differences."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.common.files import write_results
from harness.common.markdown import markdown_table
from harness.common.numbers import rounded
from harness.lab.study.study_text import DECIMALS, error_cell, setting_line
from harness.lab.study.transfer import TransferResult
from harness.lab.study.transfer_outcomes import ModelComparison, summary_lines


def write_transfer(result: TransferResult, folder: Path) -> None:
    """Write ``results.json`` and ``results.md`` into a folder, which is made if missing."""
    write_results(folder, as_json(result), as_markdown(result))


def as_json(result: TransferResult) -> dict[str, Any]:
    """Return what ``results.json`` holds."""
    comparisons = [vars(comparison) for comparison in result.comparisons]
    return {"setting": result.setting, "results": rounded(result.rows(), DECIMALS), "comparisons": comparisons}


def as_markdown(result: TransferResult) -> str:
    """Return table and comparisons as Markdown."""
    heads = ["tested on", "after", "trained on SUMO alone", "other", "difference", "interval"]
    return "\n".join(
        [
            "# Study: transfer",
            "",
            *summary_lines(result.comparisons),
            "",
            "Complete occlusion: the true state at the start, the true leader throughout, nothing measured. "
            "Mean absolute error of the longitudinal position, m, with 95 % intervals over vehicles.",
            "",
            *_table(result),
            "",
            "## Every comparison",
            "",
            "Mean absolute errors of the longitudinal position, m, and their difference with its 95 % interval over "
            "vehicles.",
            "",
            *markdown_table(heads, map(_line, sorted(result.comparisons, key=lambda each: each.better))),
            "",
            "## Setting",
            "",
            setting_line(result.setting),
            "",
        ]
    )


def _line(each: ModelComparison) -> list[str]:
    return [
        each.tested_on,
        f"{each.horizon_s:g} s",
        f"{each.own}: {each.lon_m:.2f}",
        f"{each.rival}: {each.rival_lon_m:.2f}",
        "{:+.2f} [{:+.2f}, {:+.2f}]".format(each.difference_m, *each.difference_m_ci95),
        "clear" if each.clear else "not clear",
    ]


def _table(result: TransferResult) -> list[str]:
    """Return a line for each model and a column for each test and horizon."""
    models: dict[tuple[str, str], dict[str, str]] = {}
    for row in result.rows():
        cells = models.setdefault((row["model"], row["trained_on"]), {})
        cells[f"{row['tested_on']}, {row['horizon_s']:g} s"] = error_cell(row, "lon_m")
    heads = ["model", "trained on", *next(iter(models.values()))]
    return markdown_table(heads, ([*model, *cells.values()] for model, cells in models.items()))
