"""Fits drivers and demands, writes them and prints their figures."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import typer

from harness.common.errors import InputError
from harness.common.progress import progress_bar
from harness.config.lists import seed_values
from harness.lab.fidelity.calibration import CalibrationRequest, calibrate
from harness.truth.network.network import load_network


def fit_traffic(options: Mapping[str, Any]) -> None:
    """Run ``calibrate`` with the given options; raises ``InputError`` where they are wrong."""
    net, write, out, quiet = options["net"] or "us101", options["write"], options["out"], options["quiet"]
    network = load_network(net)
    if network.calibration_file is None and write:
        raise InputError(f"`write`: {net} names no calibration_file in its network.toml")
    request = CalibrationRequest(
        fields=options["fields"],
        demand=options["demand"],
        trials=options["trials"],
        seeds=tuple(seed_values(options["seeds"])),
        duration_s=60.0 * options["minutes"],
        keep_drivers=options["keep_drivers"],
        fresh=options["fresh"],
        workers=options["workers"],
        first_step=options["step"],
        recordings=tuple(options["recordings"] or ()),
    )
    with progress_bar("calibrate", request.runs(network), quiet, before="calibrate: the first simulations") as advance:
        result = calibrate(network, request, advance, lambda line: None if quiet else typer.echo(line, err=True))
    result.write(out, network if write else None)
    if options["json"]:
        typer.echo(json.dumps(result.as_json(), indent=2))
    typer.echo(f"written to {out}{f' and {network.calibration_file}' if write else ''}", err=True)
