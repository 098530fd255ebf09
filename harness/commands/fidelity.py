"""``fidelity``: how real the simulated traffic is."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    net: Annotated[str, typer.Option(help="Network by name, or a folder with a network.toml.")] = "us101",
    demand: Annotated[
        str | None, typer.Option(help="Demands by name, with commas between. (default: all that were measured)")
    ] = None,
    seeds: Annotated[str, typer.Option(help="How many seeds, or seeds A:B, B excluded.")] = "0:5",
    minutes: Annotated[float, typer.Option(help="Simulated minutes of each run.", min=1.0, max=600.0)] = 15.0,
    fields: Annotated[
        Path | None,
        typer.Option(help="Folder of the recorded fields, to measure anew. (default: the network's measured_file)"),
    ] = None,
    recordings: Annotated[
        list[Path] | None,
        typer.Option(help="File or folder of recorded vehicles, as for run --replay; repeatable."),
    ] = None,
    workers: Annotated[int, typer.Option(help="Runs at a time, each a process.", min=1)] = 1,
    out: Annotated[Path, typer.Option(help="Folder to write.")] = Path("results/fidelity"),
    as_json: Annotated[bool, typer.Option("--json", help="Print fidelity.json on stdout, nothing else there.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress bar and no table.")] = False,
) -> None:
    """Tell how real the simulated traffic is, beside what was measured.

    Mean speed, flow, density, speed along the road, share of slow cells and
    speed of the waves, by the same estimators on both sides, with targets
    met or missed; and distances between distributions where recorded
    vehicles are given. Leaves fidelity.json, fidelity.md and figures.

    Examples:
      python -m harness fidelity --seeds 0:1 --minutes 5
      python -m harness fidelity --demand us101-0805 --workers 2
      python -m harness fidelity --fields ../shared/realdata/us101_fields
             --recordings ../shared/realdata/ngsim
             --recordings ../shared/realdata/commonroad
    """
    from harness.config.lists import names, seed_values  # noqa: PLC0415
    from harness.fidelity.comparison import FidelityRequest, compare_traffic  # noqa: PLC0415
    from harness.fidelity.report import print_fidelity, write_fidelity  # noqa: PLC0415
    from harness.truth.network.network import load_network  # noqa: PLC0415
    from harness.writing.progress import progress_bar  # noqa: PLC0415

    network = load_network(net)
    request = FidelityRequest(
        demands=names(demand, "--demand", "us101-0805") if demand is not None else (),
        seeds=tuple(seed_values(seeds)),
        duration_s=60.0 * minutes,
        fields=fields,
        recordings=tuple(recordings or ()),
        workers=workers,
    )
    with progress_bar("fidelity", request.runs(network), quiet) as advance:
        result = compare_traffic(network, request, advance)
    write_fidelity(result, out)
    if not quiet:
        print_fidelity(result)
    if as_json:
        import json  # noqa: PLC0415

        typer.echo(json.dumps(result.as_json(), indent=2))
    print(f"written to {out}", file=sys.stderr)  # noqa: T201
