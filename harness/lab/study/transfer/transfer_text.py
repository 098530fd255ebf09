"""The transfer study's folder: one table 'model x trained on x tested on', what it means, and the picture."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.common.files import save_figure, write_results
from harness.common.markdown import markdown_table
from harness.common.numbers import rounded
from harness.lab.study.figures import COLOURS
from harness.lab.study.study_text import DECIMALS, error_cell, setting_line
from harness.lab.study.transfer.models import ON_BOTH, ON_REAL
from harness.lab.study.transfer.transfer import TransferResult
from harness.lab.study.transfer.verdicts import Comparison

if TYPE_CHECKING:
    from harness.lab.study.transfer.training_sets import HeldOutPart
    from harness.lab.study.transfer.verdicts import Outcome


Row = Mapping[str, Any]
FIGURE = "transfer-errors.png"


def write_transfer(result: TransferResult, folder: Path) -> None:
    """Write ``results.json``, ``results.md`` and the picture into a folder, which is made if missing."""
    write_results(folder, as_json(result), as_markdown(result))
    save_figure(errors_figure(result.outcomes), folder / FIGURE, dpi=110)


def as_json(result: TransferResult) -> dict[str, Any]:
    """Return what ``results.json`` holds."""
    return {
        "setting": dict(result.setting),
        "results": rounded(result.rows, DECIMALS),
        "inputs": rounded(result.inputs, DECIMALS),
        "comparisons": [vars(comparison) for comparison in result.comparisons],
    }


def as_markdown(result: TransferResult) -> str:
    """Return table, verdicts and ranges as Markdown."""
    return "\n".join(
        [
            "# Study: transfer",
            "",
            *summary_lines(result.comparisons),
            "",
            "Complete occlusion: the true state at the start, the true leader throughout, nothing measured. "
            "Mean absolute error of the longitudinal position, m, with 95 % intervals over vehicles.",
            "",
            *_table(result.rows, partial(error_cell, quantity="lon_m")),
            "",
            f"![errors]({FIGURE})",
            "",
            "## Every comparison",
            "",
            "Mean absolute errors of the longitudinal position, m, and their difference with its 95 % interval over "
            "vehicles.",
            "",
            *_comparison_table(result.comparisons),
            "",
            "## Bias and coverage",
            "",
            "Mean of estimated minus true position, m; share of true positions inside the 95 % particle interval.",
            "",
            *_table(result.rows, _bias, least_s=5.0),
            "",
            "## How long an acceleration lasts",
            "",
            "Share of the acceleration at the start that the model still has; in brackets what the true vehicles have.",
            "",
            *_table(result.rows, _kept, most_s=2.0),
            "",
            "## Inputs against the training range",
            "",
            "True situations of the test traffic (5 to 95 %), the range of `gmm`'s training data, the share beyond.",
            "",
            *_input_table(result.inputs),
            "",
            "## Setting",
            "",
            setting_line(result.setting),
            "",
        ]
    )


def summary_lines(comparisons: Sequence[Comparison]) -> list[str]:
    """Return one line for each test set and model trained on simulated traffic: whom it loses to, and when."""
    lines = []
    for own in dict.fromkeys((entry.tested_on, entry.own) for entry in comparisons):
        lost = [entry for entry in comparisons if (entry.tested_on, entry.own) == own and not entry.better]
        rivals = [entry for entry in lost if entry.rival_trained_on != ON_REAL]
        kin = [entry for entry in lost if entry.rival_trained_on == ON_REAL]
        told = f"loses to {_by_rival(rivals)}" if rivals else "loses to no rival"
        behind = f"; behind {_by_rival(kin)}" if kin else ""
        lines.append(f"- on {own[0]}, {own[1]} {told}{behind}.")
    return lines


def _by_rival(lost: Sequence[Comparison]) -> str:
    times: dict[str, list[str]] = {}
    for entry in lost:
        times.setdefault(entry.rival, []).append(f"{entry.horizon_s:g} s{'' if entry.clear else ' (not clear)'}")
    return ", ".join(f"{rival} at {' and '.join(when)}" for rival, when in times.items())


def _comparison_table(comparisons: Sequence[Comparison]) -> list[str]:
    rows = [
        [
            entry.tested_on,
            f"{entry.horizon_s:g} s",
            *(f"{entry.own}: {entry.lon_m:.2f}", f"{entry.rival}: {entry.rival_lon_m:.2f}"),
            "{:+.2f} [{:+.2f}, {:+.2f}]".format(entry.difference_m, *entry.difference_m_ci95),
            "clear" if entry.clear else "not clear",
        ]
        for entry in sorted(comparisons, key=lambda entry: entry.better)
    ]
    return markdown_table(["tested on", "after", "trained on SUMO alone", "other", "difference", "interval"], rows)


def _table(rows: Sequence[Row], cell: Callable[[Row], str], least_s: float = 0.0, most_s: float = np.inf) -> list[str]:
    """Return a line for each model and a column for each test set and horizon from ``least_s`` to ``most_s``."""
    shown = [row for row in rows if least_s <= row["horizon_s"] <= most_s]
    heads = list(dict.fromkeys((row["tested_on"], row["horizon_s"]) for row in shown))
    models: dict[tuple[str, str], dict[tuple[str, float], Row]] = {}
    for row in shown:
        models.setdefault((row["model"], row["trained_on"]), {})[row["tested_on"], row["horizon_s"]] = row
    return markdown_table(
        ["model", "trained on", *(f"{tested_on}, {horizon:g} s" for tested_on, horizon in heads)],
        [[*model, *(cell(found[head]) for head in heads)] for model, found in models.items()],
    )


def _bias(row: Row) -> str:
    return f"{row['lon_bias_m']:+.2f}; {100 * row['coverage95_lon_m']:.0f} %"


def _kept(row: Row) -> str:
    return f"{row['accel_kept']:.2f} ({row['accel_kept_true']:.2f})"


def _input_table(inputs: Sequence[Row]) -> list[str]:
    rows = [
        [
            *(row[name] for name in ("tested_on", "trained_on", "input")),
            f"{row['from_5_percent']:.2f} to {row['to_95_percent']:.2f}",
            f"{row['std']:.2f}",
            f"{row['trained_from']:.2f} to {row['trained_to']:.2f}",
            f"{row['outside_percent']:.1f} %",
        ]
        for row in inputs
    ]
    heads = ["tested on", "trained on", "input", "test traffic", "std", "training range", "outside"]
    return markdown_table(heads, rows)


DASHES = {ON_REAL: "--", ON_BOTH: ":"}
# Those that the question is about; the table has all.
SHOWN = ("gmm", "gmm-short", "cvm", "cam", "idm")
LEAST_SHOWN_M = 0.02
LABEL_HEIGHT = 0.042


def errors_figure(outcomes: Sequence[Outcome]) -> Figure:
    """Draw the mean absolute position error over time."""
    names = list(dict.fromkeys(outcome.tested_on for outcome in outcomes))
    figure = Figure(figsize=(5.0 * len(names) + 1.2, 4.6), layout="constrained")
    for axis, name in zip(figure.subplots(1, len(names), squeeze=False)[0], names, strict=True):
        _panel(axis, [outcome for outcome in outcomes if outcome.tested_on == name and outcome.model.name in SHOWN])
        axis.set_title(f"tested on {name}", fontsize=10, loc="left")
        axis.set_xlabel("time without a measurement, s")
    figure.axes[0].set_ylabel("MAE of longitudinal position, m")
    figure.suptitle(
        "Complete occlusion, leader known. Trained on SUMO or nothing: solid, on real pairs: dashed, on both: dotted",
        fontsize=10,
    )
    return figure


def _panel(axis: Axes, outcomes: Sequence[Outcome]) -> None:
    ends: dict[str, tuple[float, str, str]] = {}
    first, last = outcomes[0].part, outcomes[-1].part
    for outcome in outcomes:
        colour = COLOURS.get(outcome.model.name, "#777777")
        dashes = DASHES.get(outcome.model.trained_on, "-")
        error = outcome.scores.abs_error["lon_m"].mean(axis=1)
        time_s = np.arange(1, len(error) + 1) * outcome.part.cases.step_s
        shown = time_s > (0.0 if outcome.part is first else _length_s(first))
        axis.plot(time_s[shown], error[shown], color=colour, linestyle=dashes, linewidth=1.6)
        ends[outcome.model.label] = (float(error[-1]), outcome.model.label, colour)
    if last is not first:
        axis.axvline(_length_s(first), color="0.7", linewidth=0.8)
        axis.annotate("beyond: fewer,\nlonger stretches", (_length_s(first) * 1.03, 0.99), va="top", color="0.4",
                      xycoords=("data", "axes fraction"), fontsize=8)  # fmt: skip
    axis.spines[["top", "right"]].set_visible(False)
    axis.set_yscale("log")
    axis.set_ylim(LEAST_SHOWN_M, 1.25 * max(end for end, _, _ in ends.values()))
    axis.yaxis.set_major_formatter("{x:g}")
    axis.set_xlim(0.0, _length_s(last))
    _label_ends(axis, sorted(ends.values()), _length_s(last))


def _length_s(part: HeldOutPart) -> float:
    return (part.cases.steps - 1) * part.cases.step_s


def _label_ends(axis: Axes, ends: Sequence[tuple[float, str, str]], at_s: float) -> None:
    """Write each model's name beside its line's end, from the lowest up, apart from each other and joined to it."""
    bottom, top = axis.get_ylim()
    apart = (top / bottom) ** LABEL_HEIGHT
    place = 0.0
    for end, label, colour in ends:
        place = max(end, place * apart)
        axis.annotate(
            label,
            (at_s, end),
            (at_s * 1.06, place),
            color=colour,
            fontsize=8,
            va="center",
            annotation_clip=False,
            arrowprops={
                **{"arrowstyle": "-", "color": colour, "linewidth": 0.5},
                **{"relpos": (0.0, 0.5), "shrinkA": 1.0, "shrinkB": 0.0},
            },
        )
