"""What panels over time have in common: stretches of time, marks where the ego changes, no needless frame."""

from __future__ import annotations

import pandas as pd
from matplotlib.axes import Axes


def stretch_s(duration_s: float) -> float:
    """Return a round length of time that cuts a run into some thirty stretches."""
    return next((width for width in (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0) if duration_s / width <= 40.0), 60.0)


def mark_new_egos(axes: Axes, steps: pd.DataFrame) -> None:
    """Draw a line where another vehicle became the ego, by the table's columns ``episode`` and ``time_s``."""
    for start_s in steps.groupby("episode")["time_s"].min().iloc[1:]:
        axes.axvline(start_s, color="0.6", linewidth=0.8, linestyle=":")
        axes.annotate(
            "new ego",
            (start_s, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(3, -2),
            textcoords="offset points",
            va="top",
            color="0.4",
            fontsize=8,
        )


def strip(axes: Axes) -> None:
    """Take away the frame's upper and right edge."""
    axes.spines[["top", "right"]].set_visible(False)


def label_ends(axis: Axes, ends: list[tuple[float, str, str]], at: float) -> None:
    """Write each model's name at its line's end, pushed apart where they would overlap."""
    bottom, top = 0.0, axis.get_ylim()[1]
    least = 0.055 * (top - bottom)
    place = -least
    for end, model, colour in sorted(ends):
        place = max(end, place + least)
        axis.annotate(
            model, (at, end), (at * 1.015, place), color=colour, fontsize=8, va="center", annotation_clip=False
        )
