"""The tables of a measurement on stderr and a log-log plot."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, NullFormatter
from rich.console import Console
from rich.table import Table

REAL_TIME_MS = 100.0
BUSY = 1.3


def print_tables(result: dict[str, Any], console: Console) -> None:
    """Print the trackers' times, their slopes and the mixtures' times."""
    rows = result["rows"]
    counts = sorted({row["vehicles"] for row in rows})
    heads = ["tracker", *(f"{count} vehicles" for count in counts)]

    def show(title: str, cell: Callable[[dict[str, Any]], str]) -> None:
        by_name: dict[str, dict[int, str]] = {}
        for row in rows:
            by_name.setdefault(_name(row), {})[row["vehicles"]] = cell(row)
        _show(console, title, heads, ([name, *map(own.__getitem__, counts)] for name, own in by_name.items()))

    show("Time of a step, ms: median (95th percentile), - where time was up", _wall)
    if _busyness(rows) > BUSY:
        console.print(f"The machine was busy: steps took {_busyness(rows):.1f} times their processor time. That one:")
        show("Processor time of a step, ms: median", lambda row: _number(row["cpu_ms_p50"], 1))
    show("Peak memory, MB", lambda row: _number(row["peak_mb"], 0))
    stages = (
        [_name(row), str(row["vehicles"]), ", ".join(f"{stage} {_number(ms, 2)}" for stage, ms in told.items())]
        for row in rows
        if (told := row["stages_ms_p50"])
    )
    _show(console, "Stages of this project's tracker, median ms", ["tracker", "vehicles", "stages"], stages)
    slopes = (
        [_name(row), str(row["from"]), str(row["to"]), _number(row["slope"], 2), _number(row["slope_cpu"], 2)]
        for row in result["slopes"]
    )
    _show(console, "Slope of the log-log plot", ["tracker", "from", "to", "slope", "by processor time"], slopes)
    sampled = (
        [*(str(row[key]) for key in ("components", "inputs", "particles")), _number(row["ms"], 2),
         _number(row["matrix_product_ms"], 2)]
        for row in result["gmm"]
    )  # fmt: skip
    heads = ["components", "inputs", "particles", "ms", "bare matrix product, ms"]
    _show(console, "Sampling from a conditional Gaussian mixture", heads, sampled)


def plot(result: dict[str, Any]) -> Figure:
    """Return the log-log plot of the median time of a step over the vehicles in range."""
    lines: dict[str, list[tuple[int, float]]] = {}
    for row in result["rows"]:
        if row["ms_p50"] is not None:
            lines.setdefault(_name(row), []).append((row["vehicles"], row["ms_p50"]))
    figure = Figure(figsize=(8.0, 5.5), dpi=120, layout="constrained")
    axes = figure.subplots()
    axes.set_xscale("log")
    axes.set_yscale("log")
    for name, points in lines.items():
        axes.plot(*zip(*points, strict=True), marker="o", markersize=4, label=name)
    axes.axhline(REAL_TIME_MS, color="0.6", linewidth=0.8, linestyle=":")
    counts = sorted({row["vehicles"] for row in result["rows"]})
    axes.xaxis.set_major_locator(FixedLocator(counts))
    axes.xaxis.set_major_formatter(FixedFormatter([str(count) for count in counts]))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("vehicles in range")
    axes.set_ylabel("time of a step, median, ms (dotted: real time at 10 Hz)")
    if lines:
        axes.legend(frameon=False)
    return figure


def _show(console: Console, title: str, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    table = Table(*heads, title=title)
    for row in rows:
        table.add_row(*row)
    console.print(table)


def _name(row: dict[str, Any]) -> str:
    return f"{row['tracker']} {row['model']}" if row["model"] else str(row["tracker"])


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _wall(row: dict[str, Any]) -> str:
    return "-" if row["ms_p50"] is None else f"{row['ms_p50']:.1f} ({row['ms_p95']:.1f})"


def _busyness(rows: Sequence[dict[str, Any]]) -> float:
    """Return how many times longer steps took than the processor was at work for them."""
    timed = [row for row in rows if row["ms_p50"] is not None]
    wall_ms, cpu_ms = (float(sum(row[key] for row in timed)) for key in ("ms_p50", "cpu_ms_p50"))
    return wall_ms / max(cpu_ms, 1e-9)
