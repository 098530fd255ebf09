"""``compare``: whether one run, or grid of runs, is better or worse than another."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer


def command(
    context: typer.Context,
    folders: Annotated[
        list[str] | None,
        typer.Argument(metavar="A [B]", help="Folders of runs or stress tests; one tracker of a grid as FOLDER@LABEL."),
    ] = None,
    baseline: Annotated[
        str | None, typer.Option(help="Compare the one folder with this one. (with --suite: results/reference)")
    ] = None,
    suite: Annotated[str | None, typer.Option(help="Run this suite first and compare it: standard.")] = None,
    record: Annotated[
        bool, typer.Option("--record", help="Keep the suite's result as the baseline, compare nothing.")
    ] = False,
    out: Annotated[Path, typer.Option(help="Folder for the suite's runs.")] = Path("results/suite"),
    resume: Annotated[bool, typer.Option("--resume", help="Keep the suite's runs that --out holds.")] = False,
    workers: Annotated[
        int | None, typer.Option(help="Worker processes for the suite. (default: one per core)", min=1)
    ] = None,
    tolerance: Annotated[
        float, typer.Option(help="Share of a's value by which b may be worse.", min=0.0, max=1.0)
    ] = 0.02,
    markdown: Annotated[Path | None, typer.Option(help="Write the tables to this Markdown file.")] = None,
    html: Annotated[Path | None, typer.Option(help="Write them as a page to this file.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as JSON on stdout.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress bar and no tables.")] = False,
) -> None:
    """Tell whether B is better or worse than A, metric by metric.

    Runs are paired by seed and setting; two single runs, by vehicle. Verdicts
    are corrected for the number of metrics: at most 5 % false alarms.
    Exit code 1 if anything is worse by more than the tolerance.

    Examples:
      python -m harness compare results/before results/after
      python -m harness compare results/after --baseline results/reference
      python -m harness compare 'results/stress@mmpf cvm' 'results/stress@mmpf gmm'
      python -m harness compare --suite standard --markdown comment.md
      python -m harness compare --suite standard --record
    """
    from harness.comparison.compare import compare  # noqa: PLC0415
    from harness.comparison.sources import open_source  # noqa: PLC0415
    from harness.comparison.suite import BASELINE, keep_as_baseline, run_suite  # noqa: PLC0415
    from harness.errors import InputError, RunError  # noqa: PLC0415

    given = list(folders or ())
    if record and (suite is None or given):
        raise InputError("`record`: only a suite makes a baseline; for example `suite` standard with `record`")
    if suite is not None and not given:
        before = None if record else open_source(baseline or str(BASELINE), "baseline")
        ran = run_suite(suite, out, workers=workers or os.cpu_count() or 1, resume=resume, quiet=quiet)
        if ran.failures:
            raise RunError(f"{len(ran.failures)} runs of the suite failed, the first: {ran.failures[0]}")
        if before is None:
            kept = keep_as_baseline(ran, suite, Path(baseline or BASELINE))
            typer.echo(f"baseline: {kept}", err=True)
            return
        after = open_source(str(ran.folder), "out")
    elif suite is None and len(given) == 1 and baseline is not None:
        before, after = open_source(baseline, "baseline"), open_source(given[0], "folders")
    elif suite is None and len(given) == 2 and baseline is None:
        before, after = (open_source(folder, "folders") for folder in given)
    else:
        raise InputError("compare: give two folders, one folder with `baseline`, or `suite`; for example compare A B")

    comparison = compare(before, after, tolerance)
    if not quiet:
        from harness.comparison.written import print_comparison  # noqa: PLC0415

        print_comparison(comparison)
    if markdown is not None:
        from harness.comparison.written import as_markdown  # noqa: PLC0415

        markdown.write_text(as_markdown(comparison), encoding="utf-8")
    if html is not None:
        from harness.comparison.written import as_markdown  # noqa: PLC0415
        from harness.report.folderpage import text_page  # noqa: PLC0415

        html.write_text(text_page(as_markdown(comparison)), encoding="utf-8")
    if as_json:
        import json  # noqa: PLC0415

        typer.echo(json.dumps(comparison.as_table(), indent=2))
    if comparison.regression:
        context.exit(1)
