"""Measures how long trackers take, and writes and prints the result."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import typer

from harness.common.errors import InputError
from harness.common.exit_codes import DONE, WORSE
from harness.common.files import write_text
from harness.common.markdown import markdown_table, show_markdown
from harness.common.numbers import as_json, without_nan
from harness.common.progress import progress_bar
from harness.lab.against import PAIRS, time_ratios
from harness.lab.bench import BenchPlan, run_bench

SHOWN = {"ms_p50": "median ms", "ms_p95": "p95 ms", "cpu_ms_p50": "CPU ms", "peak_mb": "peak MB", "tracks": "tracks"}
"""What the terminal shows of each row of ``bench.json``, with headings."""


def measure(options: Mapping[str, Any]) -> int:
    """Run ``bench`` with the given options and return the exit code; raises ``InputError`` where they are wrong."""
    out, quiet, against = options["out"], options["quiet"], options["against"]
    trackers = options["trackers"] or ("mmpf:residual" if against else "")
    plan = BenchPlan(
        vehicles=_counts(options["vehicles"] or ("50" if against else "10,25,50,100,200")),
        trackers=tuple(name.strip() for name in trackers.split(",") if name.strip()),
        particles=options["particles"],
        steps=options["steps"],
        seed=options["seed"],
        budget_s=options["budget"],
    )
    steps = len(plan.vehicles) * (PAIRS * len(plan.trackers) * (plan.steps - 1) if against else plan.steps)
    with progress_bar("bench", steps, quiet, before="bench: compiling, warming up") as advance:
        if against:
            result = {"against": time_ratios(against, plan, advance)}
        else:
            result = {"rows": without_nan(run_bench(plan, advance))}
    out.mkdir(parents=True, exist_ok=True)
    write_text(out / "bench.json", as_json(result))
    if not quiet:
        show_markdown(_table(result), on_stderr=True)
        typer.echo(f"written to {out}", err=True)
    if options["json"]:
        typer.echo(as_json(result), nl=False)
    return WORSE if any(row["verdict"] == "slower" for row in result.get("against", ())) else DONE


def _table(result: Mapping[str, Any]) -> str:
    """Return the tables as Markdown; a dash stands where the tracker's time was up."""

    def lines(title: str, headings: Iterable[str], rows: Iterable[Iterable[object]]) -> list[str]:
        return [f"## {title}", "", *markdown_table([*headings], [[*map(_cell, row)] for row in rows]), ""]

    if "against" in result:
        rows = result["against"]
        return "\n".join(lines("Processor time of a step, now and then", rows[0], (row.values() for row in rows)))
    # In one column, which every part of a table that is wider than the screen begins with.
    first = "tracker, vehicles"
    found = {f"{row['tracker']} {row['model'] or ''}".strip() + f", {row['vehicles']}": row for row in result["rows"]}
    text = lines(
        "Time of a step", (first, *SHOWN.values()), ((name, *map(of.get, SHOWN)) for name, of in found.items())
    )
    took = {name: row["stages_ms_p50"] for name, row in found.items() if row["stages_ms_p50"]}
    stages = dict.fromkeys(stage for of_row in took.values() for stage in of_row)
    shown = ((name, *map(of_row.get, stages)) for name, of_row in took.items())
    headings = (first, *(stage.replace("_", " ") for stage in stages))
    return "\n".join([*text, *(lines("Time of its stages, median ms", headings, shown) if took else ())])


def _cell(value: object) -> str:
    return "-" if value is None else f"{value:.2f}" if isinstance(value, float) else str(value)


def _counts(text: str) -> tuple[int, ...]:
    try:
        counts = tuple(sorted({int(word) for word in text.split(",")}))
    except ValueError:
        counts = ()
    if not counts or counts[0] < 1 or counts[-1] > 2000:
        raise InputError(f"`vehicles` {text}: give whole numbers from 1 to 2000 with commas between, for example 25,50")
    return counts
