"""The tables of a grid: Markdown for a file, rich for the screen."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from harness.markdown import markdown_table
from harness.stress.summary import BREAK_PERCENT, CURVES, Break, Point

HEADINGS = tuple(metric.label for metric in CURVES)


def as_markdown(title: str, points: Sequence[Point], broken: Sequence[Break], failures: Sequence[str]) -> str:
    """Return all curves as tables with 95 % intervals over seeds, where each tracker breaks, and what failed."""
    lines = [f"# {title}", "", "Means over seeds with 95 % bootstrap intervals over seeds.", ""]
    for axis in dict.fromkeys(point.axis for point in points):
        lines += [
            f"## Over {axis}",
            "",
            *markdown_table(["tracker", axis, *HEADINGS, "seeds"], _rows(points, axis, True)),
            "",
        ]
    if broken:
        lines += [
            "## Where each tracker breaks",
            "",
            *(f"- {break_sentence(entry)}" for entry in broken),
            "",
            DEFINITION,
            "",
        ]
    if failures:
        lines += ["## Runs that failed", "", *(f"- {failure}" for failure in failures), ""]
    return "\n".join(lines)


def print_result(
    title: str, points: Sequence[Point], broken: Sequence[Break], failures: Sequence[str], place: str
) -> None:
    """Print the same in short on stderr."""
    parts: list[Table | Text] = [Text(f"\n{title}", style="bold")]
    for axis in dict.fromkeys(point.axis for point in points):
        table = Table(title=f"Means over seeds, by {axis}", box=None, title_justify="left", padding=(0, 2, 0, 0))
        table.add_column("tracker", no_wrap=True)
        for heading in (axis.rpartition(".")[2], *(metric.heading for metric in CURVES)):
            table.add_column(heading, justify="right")
        for row in _rows(points, axis, False):
            table.add_row(*row[:-1])
        parts.append(table)
    parts += [Text(break_sentence(entry)) for entry in broken]
    parts += [Text(f"failed: {failure}", style="red") for failure in failures[:10]]
    Console(stderr=True, highlight=False).print(Group(*parts, Text(f"Results: {place}", style="bold")))


DEFINITION = (
    f"A tracker breaks where, with growing density, fewer than {BREAK_PERCENT:g} % of the occluded vehicles have their "
    "old identity again half a second after they are seen again; pooled over seeds, interpolated between densities."
)


def break_sentence(entry: Break) -> str:
    """Return in words where a tracker breaks."""
    if entry.held_to is None:
        return f"{entry.label}: too few occlusions to tell"
    if entry.density is None:
        return f"{entry.label}: holds up to {entry.held_to:g} veh/km/lane, the highest tested with enough occlusions"
    where = f"{entry.label}: breaks at {'or below ' if entry.at_lowest else ''}{entry.density:.0f} veh/km/lane"
    if entry.ci95 is None:
        return where
    low, high = (f"{end:.0f}" if end is not None else "beyond the grid" for end in entry.ci95)
    return f"{where} (95 % interval {low} to {high})"


def _rows(points: Sequence[Point], axis: str, with_intervals: bool) -> list[list[str]]:
    places = dict.fromkeys((point.label, point.value) for point in points if point.axis == axis)
    rows = []
    for label, value in places:
        here = {
            point.metric: point for point in points if (point.axis, point.label, point.value) == (axis, label, value)
        }
        cells = [_cell(here[metric.name], with_intervals) for metric in CURVES]
        place = value if isinstance(value, str) else f"{value:g}"
        rows.append([label, place, *cells, str(max(point.seeds for point in here.values()))])
    return rows


def _cell(point: Point, with_interval: bool) -> str:
    if point.mean is None:
        return "-"
    decimals = 2 if point.metric.startswith("mae") else 1
    text = f"{point.mean:.{decimals}f}"
    if with_interval and point.ci95 is not None:
        text += f" [{point.ci95[0]:.{decimals}f}, {point.ci95[1]:.{decimals}f}]"
    return text
