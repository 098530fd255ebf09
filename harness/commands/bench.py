"""``bench``: how long trackers take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypedDict

import typer

from harness.common.errors import InputError
from harness.config.options import Option


class Options(TypedDict):
    """The options of ``bench``."""

    vehicles: Annotated[str, Option("Numbers of vehicles in range, with commas between.", default="10,25,50,100,200")]
    trackers: Annotated[
        str | None,
        Option(
            "Trackers with commas between: mmpf:MODEL, stonesoup-gnn, stonesoup-gnn:coarse, ... "
            "(default: mmpf with gmm and cvm, and Stone Soup's)"
        ),
    ]
    particles: Annotated[int, Option("Particles per vehicle.", default=1000, least=10)]
    steps: Annotated[int, Option("Scans of each scene.", default=40, least=8)]
    budget: Annotated[
        float, Option("Processor seconds that a tracker has for each number of vehicles.", default=10.0, least=0.1)
    ]
    beside: Annotated[
        int, Option("Processes that spin beside the measurement, as on a busy machine.", default=0, least=0, most=64)
    ]
    seed: Annotated[int, Option("Root of all randomness.", default=0, least=0)]
    out: Annotated[Path, Option("Folder of bench.json and bench.png.", default=Path("results/bench"))]
    json: Annotated[bool, Option("Print bench.json on stdout, nothing else there.", default=False)]
    quiet: Annotated[bool, Option("No progress bar and no table.", default=False)]


def command(options: Options) -> None:
    """Measure how long a step takes by stage, over more and more vehicles.

    All trackers take in the same detections in turns, in one process.

    Examples:
      python -m harness bench
      python -m harness bench --trackers mmpf:gmm,mmpf:idm --vehicles 50,200
      python -m harness bench --vehicles 50 --beside 5
    """
    import json  # noqa: PLC0415

    from rich.console import Console  # noqa: PLC0415

    from harness.common.files import save_figure, write_text  # noqa: PLC0415
    from harness.common.numbers import without_nan  # noqa: PLC0415
    from harness.common.progress import progress_bar  # noqa: PLC0415
    from harness.lab.bench.bench import BenchPlan, run_bench  # noqa: PLC0415
    from harness.lab.bench.written import plot, print_tables  # noqa: PLC0415

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
