"""Measures how long trackers take, and writes and prints the result."""

from collections.abc import Mapping
from typing import Any

import typer

from harness.common.errors import InputError
from harness.common.exit_codes import DONE, WORSE
from harness.common.files import check_folder, write_text
from harness.common.markdown import markdown_table, show_markdown
from harness.common.numbers import as_json, without_nan
from harness.common.progress import progress_bar
from harness.config.lists import names
from harness.lab.against import PAIRS, time_ratios
from harness.lab.bench import BenchPlan, run_bench


def measure(options: Mapping[str, Any]) -> int:
    """Run ``bench`` with the given options and return the exit code; raises ``InputError`` where they are wrong."""
    out, quiet, against = options["out"], options["quiet"], options["against"]
    check_folder(out, "out")
    counts = _counts(options["vehicles"] or ("50" if against else "10,25,50,100,200"))
    trackers = options["trackers"] or ("mmpf:residual" if against else None)
    chosen = () if trackers is None else names(trackers, "trackers", "mmpf:residual")
    plan = BenchPlan(counts, chosen, *(options[name] for name in ("particles", "steps", "seed", "budget")))
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
    """Return the table as Markdown; a dash stands where the tracker's time was up, or that has no such stage."""

    def cell(value: object) -> str:
        return "-" if value is None else f"{value:.2f}" if isinstance(value, float) else str(value)

    if "against" in result:
        title, rows = "Processor time of a step, now and then", result["against"]
    else:
        title, rows = "Time of a step and its stages, median in ms", []
        stages = dict.fromkeys(stage for row in result["rows"] for stage in row["stages_ms_p50"])
        for row in result["rows"]:
            # In one column, which every part of a table that is wider than the screen begins with.
            name = {"tracker, vehicles": f"{row['tracker']} {row['model'] or ''}".strip() + f", {row['vehicles']}"}
            shown = {key: row[key] for key in ("ms_p50", "ms_p95", "cpu_ms_p50", "tracks")}
            rows.append(name | shown | {stage: row["stages_ms_p50"].get(stage) for stage in stages})
    headings = [key.replace("_", " ") for key in rows[0]]
    table = markdown_table(headings, [[*map(cell, row.values())] for row in rows])
    return "\n".join([f"## {title}", "", *table, ""])


def _counts(text: str) -> tuple[int, ...]:
    try:
        counts = tuple(sorted({int(word) for word in text.split(",")}))
    except ValueError:
        counts = ()
    if not counts or counts[0] < 1 or counts[-1] > 2000:
        raise InputError(f"`vehicles` {text}: give whole numbers from 1 to 2000 with commas between, for example 25,50")
    return counts
