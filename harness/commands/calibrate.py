"""``calibrate``: fit drivers and demands to measurements at a network's site."""

from __future__ import annotations

import json

import typer

from harness.lab.fidelity.options import CalibrationOptions


def command(options: CalibrationOptions) -> None:
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
