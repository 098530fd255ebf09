"""Texts that are compared whole: what stands in a file beside the tests is what is meant."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.ticker import FixedLocator


def equals_golden(text: str, path: Path) -> None:
    """Compare a text with a file; a missing file is written, to be looked at before it is committed."""
    if not path.exists():
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        pytest.fail(f"{path.name} was missing and is written: look at it")
    assert text == path.read_text(encoding="utf-8"), f"if that is meant, delete {path.name} and run again"


def described(figure: Figure) -> str:
    """Return all that a reader sees of a figure of lines, bars and bands, in words and numbers."""
    engine = figure.get_layout_engine()
    width, height = figure.get_size_inches()
    lines = [f"figure {width:g} x {height:g} in, {figure.dpi:g} dots an inch, {type(engine).__name__}"]
    lines += [f"heading {_text(text)}" for text in figure.texts]
    for legend in figure.legends:
        names = [text.get_text() for text in legend.get_texts()]
        place = (legend._outside_loc, legend._loc)
        lines.append(f"legend {names} in {legend._ncols} columns at {place}, frame {legend.get_frame_on()}")
    for number, axes in enumerate(figure.axes):
        lines += [f"panel {number}", *(f"  {line}" for line in _panel(axes, figure.axes[0]))]
    return "\n".join(lines) + "\n"


def _panel(axes: Axes, first: Axes) -> list[str]:
    if not axes.axison:
        return ["off"]
    shared = "" if axes is first or not axes.get_shared_x_axes().joined(axes, first) else ", as of panel 0"
    lines = [
        *(f"title {loc} {axes.get_title(loc=loc)!r}" for loc in ("left", "center") if axes.get_title(loc=loc)),
        f"title size {axes._left_title.get_fontsize():g}",
        f"x {axes.get_xlabel()!r} {_numbers(axes.get_xlim())}{shared}",
        f"y {axes.get_ylabel()!r} {_numbers(axes.get_ylim())}",
        *([_ticks(axes)] if isinstance(axes.xaxis.get_major_locator(), FixedLocator) else []),
        f"labels below {axes.xaxis.get_tick_params().get('labelbottom', True)}",
        f"spines {[name for name, spine in axes.spines.items() if spine.get_visible()]}",
    ]
    for line in axes.lines:
        style = (line.get_linestyle(), line.get_marker(), line.get_markersize(), line.get_linewidth())
        data = f"{_numbers(line.get_xdata())} {_numbers(line.get_ydata())}"
        lines.append(f"line {line.get_label()} {to_hex(line.get_color())} {style} {data}")
    for each in axes.collections:
        style = (
            [to_hex(colour) for colour in each.get_facecolor()],
            [to_hex(colour) for colour in each.get_edgecolor()],
        )
        kind = "bars" if isinstance(each, LineCollection) else "band"
        lines.append(f"{kind} {style} {_numbers(each.get_linewidth())} {each.get_alpha()}")
        # In which order a band goes round differs between versions of matplotlib.
        corners = [sorted({tuple(_numbers(vertex)) for vertex in path.vertices}) for path in each.get_paths()]
        lines += [f"  {each}" for each in corners]
    return [*lines, *(f"text {_text(text)}" for text in axes.texts)]


def _ticks(axes: Axes) -> str:
    return f"x ticks {_numbers(axes.get_xticks())} {[_text(each) for each in axes.get_xticklabels()]}"


def _text(text: Text) -> str:
    at = getattr(text, "xy", ()), getattr(text, "xyann", ()), getattr(text, "xycoords", "")
    how = text.get_horizontalalignment(), text.get_verticalalignment(), text.get_clip_on(), text.get_rotation()
    told = f"{text.get_text()!r} {text.get_fontsize():g} {to_hex(text.get_color())} {how}"
    return f"{told} {[_numbers(place) for place in at[:2]]} {at[2]}" if at[0] else told


def _numbers(values: object) -> list[float]:
    return [round(float(value), 3) for value in values]  # type: ignore[attr-defined]


def holds_golden(numbers: Mapping[str, object], path: Path) -> None:
    """Compare numbers by their names with a file that has a line for each; names that it lacks are let pass.

    Numbers may differ by a millionth, since processors round differently.
    """
    if not path.exists():
        told = {name: f"{value:.9g}" if isinstance(value, float) else str(value) for name, value in numbers.items()}
        equals_golden("".join(f"{name} {value}\n" for name, value in told.items()), path)
    known = dict(line.split(" ", 1) for line in path.read_text(encoding="utf-8").splitlines())
    for name, value in known.items():
        found = numbers.get(name)
        expected = pytest.approx(float(value), rel=1e-6, abs=1e-9, nan_ok=True) if isinstance(found, float) else value
        told_now = found if isinstance(found, float) else str(found)
        assert told_now == expected, f"{name}: if that is meant, delete {path.name} and run again"
