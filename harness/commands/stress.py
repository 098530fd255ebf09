"""``stress``: a grid of runs over density, seeds, trackers, models and any other setting."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from harness.grid.stress import RunCells

GRID, RESULT = "The grid", "How it is run"


def command(
    net: Annotated[
        str | None,
        typer.Option(
            help="Network by name, or your own: a folder or .sumocfg file. (default: us101)", rich_help_panel=GRID
        ),
    ] = None,
    densities: Annotated[
        str | None,
        typer.Option(
            help="Vehicles per km and lane: START:STOP:STEP, ends included, or A,B,C. (default: 5:65:10)",
            rich_help_panel=GRID,
        ),
    ] = None,
    demands: Annotated[
        str | None, typer.Option(help="Named demands in place of densities: A,B,C; see 'nets'.", rich_help_panel=GRID)
    ] = None,
    replay: Annotated[
        list[Path] | None,
        typer.Option(
            help="Recorded traffic in place of densities: a file, or a folder of files; repeatable.",
            rich_help_panel=GRID,
        ),
    ] = None,
    ego: Annotated[
        str | None,
        typer.Option(
            help="Recorded vehicles that carry the sensor: each in turn, each:N, auto, or an ID. (default: each)",
            rich_help_panel=GRID,
        ),
    ] = None,
    trackers: Annotated[
        str,
        typer.Option(
            help="Trackers: A,B,C; with settings of its own: mmpf+update=max_likelihood.", rich_help_panel=GRID
        ),
    ] = "mmpf",
    models: Annotated[
        str | None, typer.Option(help="Motion models of mmpf: A,B,C. (default: as in 'run')", rich_help_panel=GRID)
    ] = None,
    seeds: Annotated[
        str | None,
        typer.Option(
            help="How many seeds, or seeds A:B, B excluded. (default: 10; recorded traffic: 1)", rich_help_panel=GRID
        ),
    ] = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=VALUES", help="One more axis; repeatable.", rich_help_panel=GRID),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="Scored seconds of each run. (default: 60)", rich_help_panel=GRID)
    ] = None,
    particles: Annotated[
        int | None, typer.Option(help="Particles per vehicle, for mmpf.", rich_help_panel=GRID)
    ] = None,
    sensor: Annotated[
        str | None, typer.Option(help="lidar, radar or camera. (default: lidar)", rich_help_panel=GRID)
    ] = None,
    setting: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", help="Any setting of config.toml for all runs.", rich_help_panel=GRID
        ),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder to write.", rich_help_panel=RESULT)] = Path("results/stress"),
    resume: Annotated[
        bool, typer.Option("--resume", help="Keep the runs that --out holds, make the others.", rich_help_panel=RESULT)
    ] = False,
    retry_failed: Annotated[
        bool, typer.Option("--retry-failed", help="Like --resume, and make failed runs again.", rich_help_panel=RESULT)
    ] = False,
    workers: Annotated[
        int | None, typer.Option(help="Worker processes. (default: one per core)", min=1, rich_help_panel=RESULT)
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS", help="Run on this Dask cluster instead: tcp://host:8786.", rich_help_panel=RESULT
        ),
    ] = None,
    timeout_per_run: Annotated[
        float | None, typer.Option(help="Seconds after which a run is given up.", min=0.1, rich_help_panel=RESULT)
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print summary.json on stdout, nothing else there.", rich_help_panel=RESULT)
    ] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", help="No progress bar and no tables.", rich_help_panel=RESULT)
    ] = False,
) -> None:
    """Run many densities, trackers, models and seeds; see where each breaks.

    Truth and detections of one density and seed are made once, for all
    trackers. Leaves runs.parquet (one row per run, failed ones too),
    summary.json, table.md and figures. Exit code 3 if a run failed.
    Recorded traffic gives one table over all files instead of curves.

    Examples:
      python -m harness stress --models gmm,idm,cvm,cam --seeds 10
      python -m harness stress --trackers mmpf,mmpf+update=max_likelihood,stonesoup-jpda
      python -m harness stress --densities 30 --vary sensor.range_m=40:160:20
      python -m harness stress --densities 20,40 --duration 20 --resume
      python -m harness stress --replay FOLDER --trackers mmpf,stonesoup-jpda
      python -m harness stress --scheduler tcp://host:8786
    """
    from harness.config.model import brings_its_own_demand  # noqa: PLC0415
    from harness.errors import RunError, UserError  # noqa: PLC0415
    from harness.grid.grid import GridRequest  # noqa: PLC0415
    from harness.grid.stress import Telling, run_stress  # noqa: PLC0415

    files = _files_of(replay or [])
    given = densities is not None or demands is not None or bool(files)
    own_demand = brings_its_own_demand(net or "us101")
    request = GridRequest(
        net=net if files else net or "us101",
        densities=densities if given or own_demand else "5:65:10",
        demands=demands,
        trackers=trackers,
        models=models,
        seeds=seeds or ("1" if files else "10"),
        duration_s=duration,
        particles=particles,
        sensor=sensor,
        settings=tuple(setting or ()),
        vary=tuple(vary or ()),
        replay=tuple(map(str, files)),
        ego=ego,
    )
    if scheduler is not None and workers is not None:
        raise UserError("--workers: the cluster has its own workers; leave it out with --scheduler tcp://host:8786")
    with _execution(scheduler, workers or os.cpu_count() or 1, timeout_per_run) as execute:
        finished = run_stress(
            request,
            out,
            execute,
            resume=resume or retry_failed,
            retry_failed=retry_failed,
            user=Telling(
                quiet,
                warn=lambda line: typer.echo(f"warning: {line}", err=True),
                tell=lambda text: None if quiet else typer.echo(text, err=True),
            ),
            command=shlex.join(["harness", *sys.argv[1:]]),
        )
    from harness.report.folderpage import write_page  # noqa: PLC0415

    write_page(finished.folder)
    if files and not quiet:
        typer.echo((finished.folder / "table.md").read_text(encoding="utf-8"), err=True)
    elif not quiet:
        from harness.grid.tables import print_result  # noqa: PLC0415

        print_result(
            f"Stress test on {request.net}", finished.points, finished.breaks, finished.failures, str(finished.folder)
        )
    if as_json:
        import json  # noqa: PLC0415

        typer.echo(json.dumps(finished.summary, indent=2))
    if finished.failures:
        raise RunError(
            f"{len(finished.failures)} of {finished.summary['runs']} runs failed, the first: {finished.failures[0]}; "
            f"all rows are in {finished.folder}"
        )


def _files_of(replay: list[Path]) -> list[Path]:
    """Return the files of recorded traffic; of a folder that is no recording itself, all that it holds."""
    from harness.errors import UserError  # noqa: PLC0415

    files: list[Path] = []
    for path in replay:
        if path.is_dir() and not any(path.glob("*_tracks.csv")) and not (path / "manifest.json").is_file():
            inside = sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))
            if not inside:
                raise UserError(f"--replay: {path} has no files; give files of recorded traffic, or their folder")
            files += inside
        else:
            files.append(path)
    return files


@contextmanager
def _execution(scheduler: str | None, workers: int, timeout_s: float | None) -> Iterator[RunCells]:
    """Yield what runs the cells: processes of this machine, or a cluster."""
    from harness.grid.cluster import connect, run_cells_on_cluster  # noqa: PLC0415
    from harness.grid.pool import run_cells  # noqa: PLC0415

    if scheduler is None:
        yield lambda cells, on_row: run_cells(cells, workers, timeout_s, on_row)
        return
    with connect(scheduler) as client:
        yield lambda cells, on_row: run_cells_on_cluster(client, cells, timeout_s, on_row)
