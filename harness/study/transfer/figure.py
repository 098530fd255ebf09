"""The transfer study's picture: error over horizon, a panel for each test set and a line for each model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.study.figures import COLOURS
from harness.study.transfer.models import ON_BOTH, ON_REAL

if TYPE_CHECKING:
    from harness.study.transfer.traffic import HeldOutPart
    from harness.study.transfer.transfer import Outcome

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
