"""What a comparison leaves behind: a table on the screen, ``fidelity.json``, ``fidelity.md`` and figures."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from rich.console import Console, Group
from rich.table import Table
from rich.text import Text

from harness.errors import UserError
from harness.fidelity.comparison import Distance, Fidelity, Period
from harness.fidelity.figures import draw_figures
from harness.fidelity.targets import Target
from harness.writing.markdown import markdown_table

TARGET_HEADINGS = ("period", "figure", "simulated", "measured", "off by", "allowed", "target")
DISTANCE_HEADINGS = ("quantity", "distance", "unit", "sim. mean", "rec. mean", "sim. n", "rec. n")


def write_fidelity(result: Fidelity, folder: Path) -> None:
    """Write the result into a folder.

    Raises:
        UserError: The folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "fidelity.json").write_text(json.dumps(result.as_json(), indent=2) + "\n", encoding="utf-8")
        (folder / "fidelity.md").write_text(as_markdown(result), encoding="utf-8")
        for name, figure in draw_figures(result).items():
            figure.savefig(folder / f"{name}.png")
    except OSError as error:
        raise UserError(f"--out {folder}: cannot be written: {error.strerror}") from error


def as_markdown(result: Fidelity) -> str:
    """Return the result as Markdown."""
    lines = [
        f"# How real the traffic on {result.network} is",
        "",
        f"{result.setting['minutes']:g} simulated minutes on each of {len(result.setting['seeds'])} seeds a period; "
        f"the first minutes that the recording undercounts are left out on both sides. Measured: {result.source}.",
        "",
        *markdown_table(TARGET_HEADINGS, target_rows(result)),
        "",
        summary(result),
        "",
    ]
    if result.distances:
        lines += [
            "## Distributions",
            "",
            "Wasserstein distances between simulated and recorded vehicles; of the rate, the difference. The "
            "recordings are short windows about single vehicles, from no particular part of the periods: "
            + ", ".join(result.setting["recordings"])
            + ".",
            "",
            *markdown_table(DISTANCE_HEADINGS, [_distance_row(entry) for entry in result.distances]),
            "",
        ]
    if result.left_out:
        lines += ["## Left out", "", *(f"- {reason}" for reason in result.left_out), ""]
    return "\n".join(lines)


def print_fidelity(result: Fidelity) -> None:
    """Print the same on stderr."""
    parts: list[Table | Text] = [_table("Simulated and measured traffic", TARGET_HEADINGS, list(target_rows(result)))]
    if result.distances:
        rows = [_distance_row(entry) for entry in result.distances]
        parts.append(_table("Distances between distributions", DISTANCE_HEADINGS, rows))
    parts += [Text(f"left out: {reason}") for reason in result.left_out]
    Console(stderr=True, highlight=False).print(Group(*parts, Text(summary(result), style="bold")))


def summary(result: Fidelity) -> str:
    """Return in one sentence how many targets are met."""
    listed = [target for period in result.periods for target in period.targets]
    return f"{sum(target.met for target in listed)} of {len(listed)} targets are met."


def target_rows(result: Fidelity) -> Iterator[tuple[str, ...]]:
    """Yield one row a target."""
    for period in result.periods:
        for target in period.targets:
            yield _target_row(period, target)


def _target_row(period: Period, target: Target) -> tuple[str, ...]:
    unit = " points" if target.unit == "points" else " %"
    return (
        period.demand,
        target.name,
        _digits(target.simulated),
        _digits(target.measured),
        f"{target.error:+.1f}{unit}",
        f"{target.tolerance:g}{unit}",
        "met" if target.met else "missed",
    )


def _distance_row(entry: Distance) -> tuple[str, ...]:
    numbers = (f"{value:.2f}" for value in (entry.simulated_mean, entry.measured_mean))
    return (
        entry.quantity.replace("_", " "),
        f"{entry.distance:.2f}",
        entry.unit,
        *numbers,
        str(entry.simulated_n),
        str(entry.measured_n),
    )


def _digits(value: float) -> str:
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.2f}"


def _table(title: str, headings: tuple[str, ...], rows: list[tuple[str, ...]]) -> Table:
    table = Table(title=title, box=None, title_justify="left", padding=(0, 2, 0, 0))
    for place, heading in enumerate(headings):
        table.add_column(heading, justify="left" if place < 2 else "right", no_wrap=place < 2)
    for row in rows:
        table.add_row(*row)
    return table
