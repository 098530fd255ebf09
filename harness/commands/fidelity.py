"""``fidelity``: how real the simulated traffic is."""

import json
from pathlib import Path
from typing import Annotated, TypedDict

import typer

from harness.config import options as shared
from harness.config.options import Option


class Options(TypedDict):
    """The options of ``fidelity``."""

    net: shared.Net
    demand: Annotated[str | None, Option("Names of demands, separated by commas. (default: all with measurements)")]
    seeds: Annotated[str, Option("Number of seeds, or the range A:B without B.", default="0:5")]
    minutes: Annotated[
        float,
        Option(
            "Simulated minutes per run. The first that the recording undercounts (2 on us101) do not count.",
            default=15.0,
            least=1.0,
            most=600.0,
        ),
    ]
    fields: shared.RecordedFields
    recordings: Annotated[
        list[Path] | None, Option("File or folder of recorded vehicles, as for run --replay; repeatable.")
    ]
    workers: shared.OneWorker
    out: Annotated[Path, Option("Folder to write.", default=Path("results/fidelity"))]
    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> None:
    """Compare the simulated traffic with measured traffic.

    Compares mean speed, flow, density, speed along the road, share of slow
    cells and wave speed, with the same estimators on both sides, and says
    whether each target is met. With recorded vehicles it also compares
    distributions. Writes fidelity.json, fidelity.md and figures.

    Examples:
      python -m harness fidelity --seeds 0:1 --minutes 5
      python -m harness fidelity --demand us101-0805 --workers 2
      python -m harness fidelity --fields us101_fields
             --recordings ngsim --recordings commonroad
    """
    from harness.lab.fidelity.comparison import judge_traffic  # noqa: PLC0415

    table = judge_traffic(options)
    if options["json"]:
        typer.echo(json.dumps(table, indent=2))
    typer.echo(f"written to {options['out']}", err=True)
