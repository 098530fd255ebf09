"""Shared parts of plots over time: shaded intervals, and no needless frame."""

from __future__ import annotations

from matplotlib.axes import Axes


def stretch_s(duration_s: float) -> float:
    """Return a round length of time that cuts a run into some thirty stretches."""
    return next((width for width in (0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0) if duration_s / width <= 40.0), 60.0)


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
