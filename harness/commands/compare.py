"""``compare``: whether one run, or grid of runs, is better or worse than another."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypedDict

import typer

from harness.common.exit_codes import DONE, UNDECIDED, WORSE
from harness.config.options import Option

if TYPE_CHECKING:
    from harness.analysis.sources import Source
    from harness.analysis.verdicts import Rules


class Options(TypedDict):
    """The options of ``compare``."""

    folders: Annotated[
        list[str] | None,
        Option(
            "Folders of runs, stress tests or drives; one tracker of a grid as FOLDER@LABEL.",
            metavar="A [B]",
            is_argument=True,
        ),
    ]
    baseline: Annotated[str | None, Option("Compare the one folder with this one. (with --suite: results/reference)")]
    suite: Annotated[str | None, Option("Run this suite first and compare it: standard.")]
    record: Annotated[bool, Option("Keep the suite's result as the baseline, compare nothing.", default=False)]
    out: Annotated[Path, Option("Folder for the suite's runs.", default=Path("results/suite"))]
    resume: Annotated[bool, Option("Keep the suite's runs that --out holds.", default=False)]
    workers: Annotated[int | None, Option("Worker processes for the suite. (default: one per core)", least=1)]
    tolerance: Annotated[
        float, Option("Share of a's value by which b may be worse.", default=0.02, least=0.0, most=1.0)
    ]
    time_tolerance: Annotated[
        float,
        Option("Likewise of the time of a step, judged within one stress test.", default=0.25, least=0.0, most=100.0),
    ]
    primary: Annotated[
        str | None,
        Option(
            "Metrics that get a verdict, with commas between; the others are described. "
            "(default: mot.hota,hidden.hidden_cost_m,occlusion.same_id_percent,in_plain_view.recall,"
            "in_plain_view.worst_tenth; of drives by belief "
            "drive.collided_percent,drive.ttc_below_1_5_percent,drive.hard_brakes_per_km)"
        ),
    ]
    allow_undecided: Annotated[bool, Option("Exit code 0, not 3, where it stays undecided.", default=False)]
    markdown: Annotated[Path | None, Option("Write the tables to this Markdown file.")]
    html: Annotated[
        Path | None,
        Option("Write them as a page to this file, two runs on the same detections side by side."),
    ]
    json: Annotated[bool, Option("Print the result as JSON on stdout.", default=False)]
    quiet: Annotated[bool, Option("No progress bar and no tables.", default=False)]


def command(options: Options) -> int:
    """Tell whether B is worse than A, no worse, or whether that stays undecided.

    HOTA in sight, hidden cost and same identity get a verdict, and within one
    stress test the time of a step: "worse" beyond the tolerance, corrected
    for the number of verdicts; "no worse" where the whole 95 % interval lies
    within the tolerance; else "undecided", with how many more seeds would
    decide it. Other metrics are described. Runs are paired by seed and
    setting; two single runs, by vehicle; drives by belief ('drive') by
    episode, on collisions, short times to collision and hard brakes.
    Exit code 0: no worse. 1: worse. 3: undecided, or values are missing.

    Examples:
      python -m harness compare results/before results/after
      python -m harness compare results/after --baseline results/reference
      python -m harness compare 'results/stress@mmpf cvm' 'results/stress@mmpf gmm'
      python -m harness compare --suite standard --markdown comment.md
      python -m harness compare --suite standard --record
    """
    from harness.analysis.compare import compare  # noqa: PLC0415

    sides = _sides(options)
    if sides is None:
        return 0
    comparison = compare(*sides, _rules(options))
    if not options["quiet"]:
        from harness.analysis.comparison_text import print_comparison  # noqa: PLC0415

        print_comparison(comparison)
    markdown, html = options["markdown"], options["html"]
    if markdown is not None:
        from harness.analysis.comparison_text import as_markdown  # noqa: PLC0415

        _write(markdown, as_markdown(comparison), "markdown")
    if html is not None:
        from harness.report.comparisonpage import comparison_page  # noqa: PLC0415

        _write(html, comparison_page(comparison), "html")
    if options["json"]:
        typer.echo(json.dumps(comparison.as_table(), indent=2))
    undecided = DONE if options["allow_undecided"] else UNDECIDED
    return {"worse": WORSE, "undecided": undecided}.get(comparison.outcome, DONE)


def _rules(options: Options) -> Rules:
    from harness.analysis.verdicts import PRIMARY, Rules  # noqa: PLC0415
    from harness.config.lists import names  # noqa: PLC0415

    primary = PRIMARY if options["primary"] is None else names(options["primary"], "primary", "mot.hota")
    return Rules(options["tolerance"], options["time_tolerance"], tuple(primary))


def _write(path: Path, text: str, parameter: str) -> None:
    from harness.common.errors import InputError  # noqa: PLC0415
    from harness.common.files import write_text  # noqa: PLC0415

    try:
        write_text(path, text)
    except OSError as error:
        raise InputError(f"`{parameter}`: can't write {path}: {error.strerror}; choose another file") from None


def _sides(options: Options) -> tuple[Source, Source] | None:
    """Return what is compared; None where a suite was run to be kept as the baseline."""
    from harness.analysis.sources import open_source  # noqa: PLC0415
    from harness.common.errors import InputError, RunError  # noqa: PLC0415
    from harness.lab.suite import BASELINE, keep_as_baseline, run_suite  # noqa: PLC0415

    given, baseline, suite = list(options["folders"] or ()), options["baseline"], options["suite"]
    if options["record"] and (suite is None or given):
        raise InputError("`record`: only a suite makes a baseline; for example `suite` standard with `record`")
    if suite is not None and not given:
        before = None if options["record"] else open_source(baseline or str(BASELINE), "baseline")
        workers = options["workers"] or os.cpu_count() or 1
        ran = run_suite(suite, options["out"], workers=workers, resume=options["resume"], quiet=options["quiet"])
        if ran.failures:
            raise RunError(f"{len(ran.failures)} runs of the suite failed, the first: {ran.failures[0]}")
        if before is None:
            kept = keep_as_baseline(ran, suite, Path(baseline or BASELINE))
            typer.echo(f"baseline: {kept}", err=True)
            return None
        return before, open_source(str(ran.folder), "out")
    if suite is None and len(given) == 1 and baseline is not None:
        return open_source(baseline, "baseline"), open_source(given[0], "folders")
    if suite is None and len(given) == 2 and baseline is None:
        return open_source(given[0], "folders"), open_source(given[1], "folders")
    raise InputError("compare: give two folders, one folder with `baseline`, or `suite`; for example compare A B")
