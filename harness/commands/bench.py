"""``bench``: how long trackers take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer


def command(
    vehicles: Annotated[
        str, typer.Option(help="Numbers of vehicles in range, with commas between.")
    ] = "10,25,50,100,200",
    trackers: Annotated[
        str | None,
        typer.Option(
            help="Trackers with commas between: mmpf:MODEL, stonesoup-gnn, stonesoup-gnn:coarse, ... "
            "(default: mmpf with gmm and cvm, and Stone Soup's)"
        ),
    ] = None,
    particles: Annotated[int, typer.Option(help="Particles per vehicle.", min=10)] = 1000,
    steps: Annotated[int, typer.Option(help="Scans of each scene.", min=8)] = 40,
    budget: Annotated[
        float, typer.Option(help="Processor seconds that a tracker has for each number of vehicles.", min=0.1)
    ] = 10.0,
    seed: Annotated[int, typer.Option(help="Root of all randomness.", min=0)] = 0,
    out: Annotated[Path, typer.Option(help="Folder of bench.json and bench.png.")] = Path("results/bench"),
    as_json: Annotated[bool, typer.Option("--json", help="Print bench.json on stdout, nothing else there.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress bar and no table.")] = False,
) -> None:
    """Measure how long a step takes by stage, over more and more vehicles.

    All trackers take in the same detections in turns, in one process.

    Examples:
      python -m harness bench
      python -m harness bench --trackers mmpf:gmm,mmpf:idm --vehicles 50,200
    """
    import json  # noqa: PLC0415

    from rich.console import Console  # noqa: PLC0415

    from harness.bench.bench import BenchPlan, run_bench  # noqa: PLC0415
    from harness.bench.written import plot, print_tables  # noqa: PLC0415
    from harness.writing.numbers import without_nan  # noqa: PLC0415
    from harness.writing.progress import progress_bar  # noqa: PLC0415

    plan = BenchPlan(
        vehicles=_counts(vehicles),
        trackers=tuple(name.strip() for name in trackers.split(",")) if trackers else (),
        particles=particles,
        steps=steps,
        seed=seed,
        budget_s=budget,
    )
    with progress_bar("bench", len(plan.vehicles) * plan.steps, quiet) as advance:
        result = without_nan(run_bench(plan, advance))
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(result, indent=2, allow_nan=False) + "\n"
    (out / "bench.json").write_text(text, encoding="utf-8")
    plot(result).savefig(out / "bench.png")
    if not quiet:
        print_tables(result, Console(stderr=True))
        typer.echo(f"written to {out}", err=True)
    if as_json:
        typer.echo(text, nl=False)


def _counts(text: str) -> tuple[int, ...]:
    from harness.errors import InputError  # noqa: PLC0415

    try:
        counts = tuple(sorted({int(word) for word in text.split(",")}))
    except ValueError:
        counts = ()
    if not counts or counts[0] < 1 or counts[-1] > 2000:
        raise InputError(f"`vehicles` {text}: give whole numbers from 1 to 2000 with commas between, for example 25,50")
    return counts
