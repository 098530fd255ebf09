"""``calibrate``: drivers and demands fitted to what was measured at a network's site."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    net: Annotated[str, typer.Option(help="Network by name, or a folder with a network.toml.")] = "us101",
    fields: Annotated[
        Path | None,
        typer.Option(help="Folder of the recorded fields, to measure anew. (default: the network's measured_file)"),
    ] = None,
    demand: Annotated[
        str | None, typer.Option(help="Only this demand; the drivers then stay as they are. (default: all measured)")
    ] = None,
    trials: Annotated[int, typer.Option(help="Candidates that are simulated.", min=1, max=1000)] = 8,
    seeds: Annotated[
        str, typer.Option(help="Seeds A:B of the first candidate's runs, B excluded; each further takes the next.")
    ] = "1000:1001",
    minutes: Annotated[
        float, typer.Option(help="Simulated minutes of a run; the schedule is compressed to them.", min=2.0, max=60.0)
    ] = 15.0,
    step: Annotated[
        float,
        typer.Option(
            help="Share of what is missing that the first step makes up for; less to go on.", min=0.1, max=1.0
        ),
    ] = 0.9,
    keep_drivers: Annotated[
        bool, typer.Option("--keep-drivers", help="Fit the demands only: models that were trained stay valid.")
    ] = False,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Begin with the measurements, not with the calibration that is there.")
    ] = False,
    workers: Annotated[int, typer.Option(help="Runs at a time, each a process.", min=1)] = 1,
    write: Annotated[bool, typer.Option("--write", help="Write the outcome into the network's folder.")] = False,
    out: Annotated[Path, typer.Option(help="Folder to write.")] = Path("results/calibration"),
    as_json: Annotated[
        bool, typer.Option("--json", help="Print calibration.json on stdout, nothing else there.")
    ] = False,
    quiet: Annotated[bool, typer.Option("--quiet", help="No progress bar and no tables.")] = False,
) -> None:
    """Fit drivers and demands to measured speed, flow, density and waves.

    A fixed-point search: each trial simulates all demands, and every
    parameter is moved by what its own figure is off. Leaves calibration.json
    (all trials) and calibration.toml (the mean of the later half of the
    candidates); --write puts the latter into the network's folder, where
    every later run reads it.
    Judge the outcome on other seeds with 'fidelity'.

    Examples:
      python -m harness calibrate --trials 4 --minutes 5
      python -m harness calibrate --fields ../shared/realdata/us101_fields --write
      python -m harness calibrate --keep-drivers --trials 5 --write
      python -m harness calibrate --demand us101-0750 --seeds 1000:1003
    """
    from harness.config.lists import seed_values  # noqa: PLC0415
    from harness.errors import InputError  # noqa: PLC0415
    from harness.fidelity.calibration import CalibrationRequest, calibrate  # noqa: PLC0415
    from harness.truth.network.network import load_network  # noqa: PLC0415
    from harness.writing.progress import progress_bar  # noqa: PLC0415

    network = load_network(net)
    if network.calibration_file is None and write:
        raise InputError(f"`write`: {net} names no calibration_file in its network.toml")
    request = CalibrationRequest(
        fields=fields,
        demand=demand,
        trials=trials,
        seeds=tuple(seed_values(seeds)),
        duration_s=60.0 * minutes,
        keep_drivers=keep_drivers,
        fresh=fresh,
        workers=workers,
        first_step=step,
    )
    with progress_bar("calibrate", request.runs(network), quiet) as advance:
        result = calibrate(network, request, advance, lambda line: None if quiet else typer.echo(line, err=True))
    result.write(out, network if write else None)
    if as_json:
        import json  # noqa: PLC0415

        typer.echo(json.dumps(result.as_json(), indent=2))
    print(f"written to {out}{f' and {network.calibration_file}' if write else ''}", file=sys.stderr)  # noqa: T201
