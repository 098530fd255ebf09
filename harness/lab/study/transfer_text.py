"""The transfer study's folder: a table of model x training x test traffic, the differences, and a figure."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from harness.common.files import save_figure, write_results
from harness.common.markdown import markdown_table
from harness.common.numbers import rounded
from harness.common.plots import label_ends, strip
from harness.lab.study.figures import COLOURS
from harness.lab.study.study_text import DECIMALS, error_cell, setting_line
from harness.lab.study.transfer import SHORT_STEPS, TransferResult
from harness.lab.study.transfer_outcomes import ON_BOTH, ON_REAL, ModelComparison, TransferOutcome, summary_lines

FIGURE = "transfer-errors.png"
DASHES = {ON_REAL: "--", ON_BOTH: ":"}


def write_transfer(result: TransferResult, folder: Path) -> None:
    """Write ``results.json``, ``results.md`` and the picture into a folder, which is made if missing."""
    write_results(folder, as_json(result), as_markdown(result))
    save_figure(errors_figure(result.outcomes), folder / FIGURE, dpi=110)


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
            f"![errors]({FIGURE})",
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


def errors_figure(outcomes: Sequence[TransferOutcome]) -> Figure:
    """Draw the mean absolute position error over time, a panel for each traffic that was tested on."""
    names = list(dict.fromkeys(outcome.test.tested_on for outcome in outcomes))
    figure = Figure(figsize=(5.0 * len(names) + 1.2, 4.6), layout="constrained")
    for axis, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
        ends: dict[str, tuple[float, str, str]] = {}
        time_s = np.zeros(1)
        for outcome in outcomes:
            if outcome.test.tested_on != name:
                continue
            model, error = outcome.model, outcome.scores.abs_error["lon_m"].mean(axis=1)
            time_s = np.asarray(np.arange(1, len(error) + 1) * outcome.test.cases.step_s)
            # Longer windows, of which there are fewer, are drawn from where shorter ones end.
            shown = slice(SHORT_STEPS - 1 if model.label in ends else 0, None)
            colour = COLOURS.get(model.name, "#777777")
            axis.plot(time_s[shown], error[shown], color=colour, linestyle=DASHES.get(model.trained_on, "-"))
            ends[model.label] = (float(error[-1]), model.label, colour)
        axis.set_title(f"tested on {name}", fontsize=10, loc="left")
        axis.set_xlabel("time without a measurement, s")
        axis.set_ylim(bottom=0.0)
        axis.set_xlim(0.0, time_s[-1])
        label_ends(axis, list(ends.values()), float(time_s[-1]))
        strip(axis)
    figure.axes[0].set_ylabel("MAE of longitudinal position, m")
    figure.suptitle(
        "Leader known. Trained on SUMO or nothing: solid, on real pairs: dashed, on both: dotted", fontsize=10
    )
    return figure
