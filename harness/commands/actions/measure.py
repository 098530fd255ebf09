"""The time that trackers take: measured, written and told."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import typer
from rich.console import Console

from harness.common.errors import InputError
from harness.common.files import save_figure, write_text
from harness.common.numbers import without_nan
from harness.common.progress import progress_bar
from harness.lab.bench.bench import BenchPlan, run_bench
from harness.lab.bench.bench_text import plot, print_tables


def measure(options: Mapping[str, Any]) -> None:
    """Do what the options of ``bench`` ask for; raises ``InputError`` where they are wrong."""
    out, quiet = options["out"], options["quiet"]
    plan = BenchPlan(
        vehicles=_counts(options["vehicles"]),
        trackers=tuple(name.strip() for name in (options["trackers"] or "").split(",") if name.strip()),
        particles=options["particles"],
        steps=options["steps"],
        seed=options["seed"],
        budget_s=options["budget"],
        beside=options["beside"],
    )
    steps = len(plan.vehicles) * plan.steps
    with progress_bar("bench", steps, quiet, before="bench: compiling, warming up") as advance:
        result = without_nan(run_bench(plan, advance))
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(result, indent=2, allow_nan=False) + "\n"
    write_text(out / "bench.json", text)
    save_figure(plot(result), out / "bench.png")
    if not quiet:
        print_tables(result, Console(stderr=True))
        typer.echo(f"written to {out}", err=True)
    if options["json"]:
        typer.echo(text, nl=False)


def _counts(text: str) -> tuple[int, ...]:
    try:
        counts = tuple(sorted({int(word) for word in text.split(",")}))
    except ValueError:
        counts = ()
    if not counts or counts[0] < 1 or counts[-1] > 2000:
        raise InputError(f"`vehicles` {text}: give whole numbers from 1 to 2000 with commas between, for example 25,50")
    return counts
