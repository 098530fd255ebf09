"""``fidelity``: how real the simulated traffic is."""

from __future__ import annotations

import json

import typer

from harness.lab.fidelity.options import FidelityOptions


def command(options: FidelityOptions) -> None:
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
    from harness.lab.fidelity.report import judge_traffic  # noqa: PLC0415

    table = judge_traffic(options)
    if options["json"]:
        typer.echo(json.dumps(table, indent=2))
    typer.echo(f"written to {options['out']}", err=True)
