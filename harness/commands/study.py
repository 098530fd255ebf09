"""``study``: the published lane-keeping and lane-change cases on held-out traffic."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    case: Annotated[str, typer.Argument(help="lane-keeping or lane-change.")],
    net: Annotated[str, typer.Option(help="Network by name, or your own: a folder or .sumocfg file.")] = "us101",
    models: Annotated[
        str | None, typer.Option(help="Models by name, with commas between. (default: all that suit the case)")
    ] = None,
    model_file: Annotated[
        Path | None, typer.Option(help="A fitted model of your own in place of the gmm that comes along.")
    ] = None,
    cases: Annotated[int, typer.Option(help="Held-out cases.", min=2)] = 240,
    particles: Annotated[int, typer.Option(help="Particles per case.", min=2)] = 1000,
    seed: Annotated[int, typer.Option(help="Root of all randomness.", min=0)] = 0,
    seeds: Annotated[
        str, typer.Option(help="Seeds A:B of the traffic, B excluded; below 100 none was trained on.")
    ] = "0:16",
    cache: Annotated[
        Path | None, typer.Option(help="Folder of recorded traffic. (default: results/cache/traffic/NET-...)")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder to write. (default: results/study-CASE)")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print results.json on stdout, nothing else there.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress bar.")] = False,
) -> None:
    """Predict through partial and complete occlusion with every motion model, as the paper's two cases do.

    Writes results.json, results.md (tables with 95 % intervals, targets met
    and missed), figures, and all of it as one page, report.html.

    Examples:
      python -m harness study lane-keeping
      python -m harness study lane-change --models gmm,cvm,cam --cases 100
    """
    from harness.errors import UserError  # noqa: PLC0415
    from harness.progress import progress_bar  # noqa: PLC0415
    from harness.report.folderpage import write_page  # noqa: PLC0415
    from harness.study.published import StudyPlan, make_study  # noqa: PLC0415
    from harness.study.seeds import seed_range  # noqa: PLC0415
    from harness.study.written import as_json as json_of  # noqa: PLC0415
    from harness.study.written import as_markdown, write_study  # noqa: PLC0415
    from harness.truth.network import load_network  # noqa: PLC0415

    first, count = seed_range(seeds)
    chosen = tuple(name.strip() for name in models.split(",")) if models else ()
    plan = StudyPlan(case, chosen, model_file, cases, particles, seed, first, count, cache)
    network = load_network(net)

    def say(line: str) -> None:
        if not quiet:
            typer.echo(line, err=True)

    try:
        with progress_bar(
            f"study {case}", plan.runs if case in ("lane-keeping", "lane-change") else 1, quiet
        ) as advance:
            result, targets, setting = make_study(plan, network, say, advance)
    except ValueError as error:
        raise UserError(f"--model-file {model_file}: {error}") from error
    folder = out or Path("results") / f"study-{case}"
    write_study(result, targets, setting, folder)
    write_page(folder)
    if as_json:
        import json  # noqa: PLC0415

        typer.echo(json.dumps(json_of(result, targets, setting)))
    else:
        typer.echo(as_markdown(result, targets, setting))
    print(f"written to {folder}", file=sys.stderr)  # noqa: T201
