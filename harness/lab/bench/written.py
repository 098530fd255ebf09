"""The measurement for people: a table on stderr and a log-log plot."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import FixedFormatter, FixedLocator, NullFormatter
from rich.console import Console
from rich.table import Table

COLOURS = ("#0072B2", "#56B4E9", "#D55E00", "#E69F00", "#882255", "#CC79A7", "#999999")
REAL_TIME_MS = 100.0
BUSY = 1.3


def print_tables(result: dict[str, Any], console: Console) -> None:
    """Print the trackers' times, their slopes and the mixtures' times."""
    console.print(_times(result["rows"], "Time of a step, ms: median (95th percentile), - where time was up", _wall))
    busy = _busyness(result["rows"])
    if busy > BUSY:
        console.print(f"The machine was busy: steps took {busy:.1f} times their processor time. That one:")
        console.print(_times(result["rows"], "Processor time of a step, ms: median", _processor))
    console.print(_stages(result["rows"]))
    console.print(_slopes(result["slopes"]))
    console.print(_mixtures(result["gmm"]))


def plot(result: dict[str, Any]) -> Figure:
    """Return the log-log plot of the median time of a step over the vehicles in range."""
    figure = Figure(figsize=(8.0, 5.5), dpi=120, layout="constrained")
    axes = figure.subplots()
    lines = _lines(result["rows"])
    axes.set_xscale("log")
    axes.set_yscale("log")
    ends = []
    for place, (name, points) in enumerate(lines.items()):
        colour = COLOURS[place % len(COLOURS)]
        vehicles, ms = zip(*points, strict=True)
        axes.plot(vehicles, ms, color=colour, marker="o", markersize=4, linewidth=1.8 if place == 0 else 1.2)
        ends.append((ms[-1], vehicles[-1], name, colour))
    counts = sorted({row["vehicles"] for row in result["rows"]})
    axes.axhline(REAL_TIME_MS, color="0.6", linewidth=0.8, linestyle=":")
    axes.annotate("real time at 10 Hz", (counts[0], REAL_TIME_MS), xytext=(0, 3), textcoords="offset points",
                  color="0.4", fontsize=8)  # fmt: skip
    height = 0.0
    for last_ms, vehicles_there, name, colour in sorted(ends):
        if vehicles_there < counts[-1]:
            axes.annotate(name, (vehicles_there, last_ms), xytext=(0, 6), textcoords="offset points", color=colour,
                          ha="right")  # fmt: skip
            continue
        height = max(last_ms, 1.35 * height)
        axes.text(1.08 * vehicles_there, height, name, color=colour, va="center")
    axes.xaxis.set_major_locator(FixedLocator(counts))
    axes.xaxis.set_major_formatter(FixedFormatter([str(count) for count in counts]))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlim(0.9 * counts[0], 2.6 * counts[-1])
    axes.set_xlabel("vehicles in range")
    axes.set_ylabel("time of a step, median, ms")
    axes.spines[["top", "right"]].set_visible(False)
    return figure


def _lines(rows: Sequence[dict[str, Any]]) -> dict[str, list[tuple[int, float]]]:
    lines: dict[str, list[tuple[int, float]]] = {}
    for row in rows:
        if row["ms_p50"] is not None:
            lines.setdefault(_name(row), []).append((row["vehicles"], row["ms_p50"]))
    return lines


def _name(row: dict[str, Any]) -> str:
    return f"{row['tracker']} {row['model']}" if row["model"] else str(row["tracker"])


def _times(rows: Sequence[dict[str, Any]], title: str, cell: Callable[[dict[str, Any]], str]) -> Table:
    counts = sorted({row["vehicles"] for row in rows})
    table = _table(title, ["tracker"], ["particles", *(f"{count} vehicles" for count in counts), "peak MB"])
    for name in dict.fromkeys(_name(row) for row in rows):
        own = {row["vehicles"]: row for row in rows if _name(row) == name}
        particles = next(iter(own.values()))["particles"]
        cells = [cell(own[count]) for count in counts]
        peak = max(row["peak_mb"] for row in own.values())
        table.add_row(name, "" if particles is None else str(particles), *cells, f"{peak:.0f}")
    return table


def _table(title: str, words: Sequence[str], numbers: Sequence[str]) -> Table:
    table = Table(title=title)
    for heading in words:
        table.add_column(heading)
    for heading in numbers:
        table.add_column(heading, justify="right")
    return table


def _wall(row: dict[str, Any]) -> str:
    return "-" if row["ms_p50"] is None else f"{row['ms_p50']:.1f} ({row['ms_p95']:.1f})"


def _processor(row: dict[str, Any]) -> str:
    return "-" if row["cpu_ms_p50"] is None else f"{row['cpu_ms_p50']:.1f}"


def _busyness(rows: Sequence[dict[str, Any]]) -> float:
    """Return how many times longer steps took than the processor was at work for them."""
    timed = [row for row in rows if row["ms_p50"] is not None]
    wall_ms, cpu_ms = (float(sum(row[key] for row in timed)) for key in ("ms_p50", "cpu_ms_p50"))
    return wall_ms / max(cpu_ms, 1e-9)


def _stages(rows: Sequence[dict[str, Any]]) -> Table:
    told = [row for row in rows if row["stages_ms_p50"]]
    counts = sorted({row["vehicles"] for row in told})
    heads = [f"{count} vehicles" for count in counts]
    table = _table("Stages of this project's tracker, median ms", ["tracker", "stage"], heads)
    for name in dict.fromkeys(_name(row) for row in told):
        own = {row["vehicles"]: row["stages_ms_p50"] for row in told if _name(row) == name}
        for stage in dict.fromkeys(stage for stages in own.values() for stage in stages):
            times = [own.get(count, {}).get(stage) for count in counts]
            cells = ["-" if took_ms is None else f"{took_ms:.2f}" for took_ms in times]
            table.add_row(name, stage, *cells)
    return table


def _slopes(slopes: Sequence[dict[str, Any]]) -> Table:
    table = _table("Slope of the log-log plot", ["tracker"], ["from", "to", "slope", "by processor time"])
    for row in slopes:
        table.add_row(_name(row), str(row["from"]), str(row["to"]), f"{row['slope']:.2f}", f"{row['slope_cpu']:.2f}")
    return table


def _mixtures(rows: Sequence[dict[str, Any]]) -> Table:
    heads = ["components", "inputs", "particles", "ms", "bare matrix product, ms"]
    table = _table("Sampling from a conditional Gaussian mixture", [], heads)
    for row in rows:
        sizes = (str(row[name]) for name in ("components", "inputs", "particles"))
        table.add_row(*sizes, f"{row['ms']:.2f}", f"{row['matrix_product_ms']:.2f}")
    return table
