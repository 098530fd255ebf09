"""Compares two sides, and prints and writes the result as the options of ``compare`` say."""

import json
import os
import shutil
from collections.abc import Mapping
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import typer

from harness.analysis.compare import compare
from harness.analysis.comparison_text import as_markdown, print_comparison
from harness.analysis.gate import as_junit, as_summary
from harness.analysis.rules import read_gate
from harness.analysis.sources import STANDARD, Source, open_source
from harness.common.errors import InputError, RunError
from harness.common.exit_codes import DONE, UNDECIDED, WORSE
from harness.common.files import replacing, write_text, writing
from harness.common.progress import working
from harness.config.lists import names
from harness.grid.grid import GridRequest
from harness.grid.making import TABLE, on_stderr
from harness.grid.pool import run_cells
from harness.grid.stress import FinishedGrid, run_stress
from harness.storage import run_folder as runfolder
from harness.storage.grid_folder import GRID, RUNS
from mmpf.registry import UnknownNameError, imported

MARK = "<!-- written by harness compare -->"
WRITTEN = ("markdown", "html", "junit", "summary")


def compare_sides(options: Mapping[str, Any]) -> int:
    """Compare what the options name, and return the exit code: done, worse or undecided."""
    _check_used(options)
    _check_distinct(options)
    for parameter in WRITTEN:
        path = options[parameter]
        if path is not None and not path.absolute().parent.is_dir():
            raise InputError(f"`{parameter}`: there is no folder {path.parent}; make it, or choose another file")
        if path is None or options["force"] or not path.is_file() or not path.stat().st_size:
            continue
        if not _is_comparison(path):
            raise InputError(f"`{parameter}`: {path} exists and no comparison wrote it; add `force` to replace it")
    gate = read_gate(options["gate"])
    named = None if options["primary"] is None else names(options["primary"], "primary", "mot.hota")
    primary = None if named is None else tuple(map(_metric, named))
    rules = gate.rules(options["tolerance"], options["time_tolerance"], primary)
    if (sides := _sides(options)) is None:
        return DONE
    with working("comparing", options["quiet"]):
        comparison = compare(*sides, rules, options["allow_different"])
    if not options["quiet"]:
        print_comparison(comparison)
    if options["html"] is not None:
        from harness.report.comparison_page import comparison_page  # noqa: PLC0415  matplotlib is slow to import

        _write(options["html"], comparison_page(comparison), "html")
    summary = partial(as_summary, pages=options["pages"])
    for name, as_text in (("markdown", as_markdown), ("junit", as_junit), ("summary", summary)):
        if options[name] is not None:
            _write(options[name], as_text(comparison), name)
    if options["json"]:
        typer.echo(json.dumps(comparison.as_table(), indent=2))
    undecided = DONE if options["allow_undecided"] or gate.allow_undecided else UNDECIDED
    return {"worse": WORSE, "undecided": undecided}.get(comparison.outcome, DONE)


def _metric(name: str) -> str:
    """Return the key of a metric; of MODULE:KEY, after importing the module that registers it."""
    module, _, key = name.rpartition(":")
    if module:
        try:
            imported(partial(import_module, module), module)
        except UnknownNameError as error:
            raise InputError(f"`primary`: {error}") from None
    return key


def _check_used(options: Mapping[str, Any]) -> None:
    """Refuse what would be ignored."""
    for name, needed in (("workers", "suite"), ("out", "suite"), ("resume", "suite"), ("pages", "summary")):
        if options[name] and options[needed] is None:
            raise InputError(f"`{name}`: only `{needed}` uses it; leave it out, or add `{needed}`")
    for name in (*WRITTEN, "gate", "primary", "tolerance", "time_tolerance") if options["record"] else ():
        if options[name] is not None:
            raise InputError(f"`{name}`: with `record` nothing is compared; leave one of them out")


def _check_distinct(options: Mapping[str, Any]) -> None:
    """Refuse to write a file that another option names, or that what is compared has; a stream may take several."""
    compared = {
        Path(str(each).partition("@")[0]).resolve() for each in (*(options["folders"] or ()), options["baseline"])
    }
    taken: dict[Path, str] = {}
    for name in ("gate", *WRITTEN):
        if options[name] is None or (options[name].exists() and not options[name].is_file()):
            continue
        place = options[name].resolve()
        if place in taken:
            raise InputError(f"`{name}`: {options[name]} is `{taken[place]}` too; give each a file of its own")
        taken[place] = name
        if name != "gate" and place.is_file() and compared & set(place.parents) and not _is_comparison(place):
            raise InputError(f"`{name}`: {options[name]} is of what is compared; choose another file")


def _is_comparison(path: Path) -> bool:
    return path.read_bytes().endswith(f"{MARK}\n".encode())


def _write(path: Path, text: str, parameter: str) -> None:
    with writing(parameter, path):
        write_text(path, f"{text.rstrip()}\n{MARK}\n")


def _sides(options: Mapping[str, Any]) -> tuple[Source, Source] | None:
    """Return what is compared; None where a suite was run to be kept as the baseline."""
    given, baseline, suite = list(options["folders"] or ()), options["baseline"], options["suite"]
    if options["record"] and (suite is None or given):
        raise InputError("`record`: only a suite makes a baseline; for example `suite` standard with `record`")
    if suite not in (None, *SUITES):
        raise InputError(f"`suite` {suite}: no such suite; choose one of {', '.join(SUITES)}")
    if suite is not None and not given:
        before = None if options["record"] else open_source(baseline or str(BASELINE), "baseline")
        workers = options["workers"] or os.cpu_count() or 1
        out = options["out"] or Path("results/suite")
        ran = run_stress(
            SUITES[suite],
            out,
            lambda cells, on_row: run_cells(cells, workers, None, on_row),
            resume=options["resume"],
            user=on_stderr(options["quiet"]),
            command=f"harness compare --suite {suite}",
        )
        if ran.failures:
            raise RunError(f"{len(ran.failures)} runs of the suite failed, the first: {ran.failures[0]}")
        if before is None:
            kept = keep_as_baseline(ran, suite, Path(baseline or BASELINE))
            typer.echo(f"baseline: {kept}", err=True)
            return None
        return before, open_source(str(ran.folder), "out")
    if suite is None and len(given) == 1 and baseline is not None:
        return open_source(baseline, "baseline"), open_source(given[0], "b")
    if suite is None and len(given) == 2 and baseline is None:
        return open_source(given[0], "a"), open_source(given[1], "b")
    raise InputError("compare: give two folders, one folder with `baseline`, or `suite`; for example compare A B")


SUITES = {
    STANDARD: GridRequest(
        net="us101", densities="20,40", trackers="mmpf", models="cvm,gmm", seeds="10", duration_s=30.0, particles=200
    )
}
BASELINE = Path("results/reference")
KEPT = (RUNS, GRID, TABLE, runfolder.MANIFEST)


def keep_as_baseline(finished: FinishedGrid, name: str, baseline: Path) -> Path:
    """Copy what later comparisons need into the folder of baselines, over an earlier one, and return where it lies."""
    folder = baseline / name
    folder.mkdir(parents=True, exist_ok=True)
    for file in KEPT:
        with replacing(folder / file) as temporary:
            shutil.copyfile(finished.folder / file, temporary)
    return folder
