"""``calibrate``: fit drivers and demands to measurements at a network's site."""

import json
from pathlib import Path
from typing import Annotated, TypedDict

import typer

from harness.config import options as shared
from harness.config.options import Option


class Options(TypedDict):
    """The options of ``calibrate``."""

    net: shared.Net
    fields: shared.RecordedFields
    recordings: Annotated[
        list[Path] | None,
        Option(
            "File or folder of recorded vehicles, to repeat the measurement of lane changes and accelerations; "
            "repeatable. (default: the network's measured_file)"
        ),
    ]
    demand: Annotated[str | None, Option("Fit only this demand and keep the drivers. (default: all measured)")]
    trials: Annotated[int, Option("Number of candidates to simulate.", default=8, least=1, most=1000)]
    seeds: Annotated[
        str,
        Option(
            "Seeds A:B of the first candidate's runs, without B; each further candidate takes the next seeds.",
            default="1000:1001",
        ),
    ]
    minutes: Annotated[
        float,
        Option(
            "Simulated minutes per run, to which the demand schedule is scaled.", default=15.0, least=2.0, most=60.0
        ),
    ]
    step: Annotated[
        float,
        Option("Share of the error that the first step corrects; later ones less.", default=0.9, least=0.1, most=1.0),
    ]
    keep_drivers: Annotated[bool, Option("Fit only the demands, so that trained models stay valid.", default=False)]
    fresh: Annotated[bool, Option("Start from the measurements instead of the existing calibration.", default=False)]
    workers: shared.OneWorker
    write: Annotated[bool, Option("Write the result to the network's folder.", default=False)]
    out: Annotated[Path, Option("Folder to write.", default=Path("results/calibration"))]
    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> None:
    """Fit drivers and demands to measured speed, flow, density and waves.

    A fixed-point search: each trial simulates all demands and corrects every
    parameter by the error of the quantity it controls. Writes
    calibration.json (all trials) and calibration.toml (the mean of the later
    half of the candidates). --write stores the latter in the network's
    folder, where every later run reads it.
    Check the result on other seeds with 'fidelity'.

    Examples:
      python -m harness calibrate --trials 4 --minutes 5
      python -m harness calibrate --fields us101_fields --write
      python -m harness calibrate --keep-drivers --trials 5 --write
      python -m harness calibrate --demand us101-0750 --seeds 1000:1003
    """
    from harness.lab.fidelity.calibration import calibrate  # noqa: PLC0415

    trials, files = calibrate(options, lambda line: None if options["quiet"] else typer.echo(line, err=True))
    if options["json"]:
        typer.echo(json.dumps(trials, indent=2))
    typer.echo(f"written to {' and '.join(map(str, files))}", err=True)
