"""``run``: drive, sense, track and score once."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

TRAFFIC, TRACKING, RESULT = "Traffic and sensor", "Tracker", "Configuration and result"


def command(
    net: Annotated[
        str | None,
        typer.Option(
            help="Network by name, or your own: a folder or .sumocfg file. (default: us101)", rich_help_panel=TRAFFIC
        ),
    ] = None,
    density: Annotated[
        float | None,
        typer.Option(help="Vehicles per km and main lane, 5 to 65, in place of --demand.", rich_help_panel=TRAFFIC),
    ] = None,
    demand: Annotated[
        str | None,
        typer.Option(
            help="Named demand of the network; see 'nets'. (default: us101-0805 on us101)", rich_help_panel=TRAFFIC
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(help="Scored seconds; warm-up comes on top. (default: 60)", rich_help_panel=TRAFFIC)
    ] = None,
    sensor: Annotated[
        str | None, typer.Option(help="lidar, radar or camera. (default: lidar)", rich_help_panel=TRAFFIC)
    ] = None,
    replay: Annotated[
        Path | None,
        typer.Option(
            help="A run folder, whose truth and detections are used again; or a file of recorded traffic: CommonRoad "
            "XML, NGSIM CSV or text, highD folder, SUMO FCD. No SUMO.",
            rich_help_panel=TRAFFIC,
        ),
    ] = None,
    format_: Annotated[
        str | None,
        typer.Option(
            "--format",
            help="Format of recorded traffic: commonroad, ngsim, ngsim-text, highd, fcd. (default: by its content)",
            rich_help_panel=TRAFFIC,
        ),
    ] = None,
    ego: Annotated[
        str | None,
        typer.Option(
            help="Recorded vehicle that carries the sensor: its ID, auto, each in turn, or each:N. (default: auto)",
            rich_help_panel=TRAFFIC,
        ),
    ] = None,
    gui: Annotated[
        bool,
        typer.Option(
            "--gui",
            help="Watch the traffic in a window of sumo-gui while it runs; same results. Close it to stop. "
            "(extra: networks)",
            rich_help_panel=TRAFFIC,
        ),
    ] = False,
    tracker: Annotated[
        str | None, typer.Option(help="Tracker by name. (default: mmpf)", rich_help_panel=TRACKING)
    ] = None,
    model: Annotated[
        str | None,
        typer.Option(help="Motion model by name, e.g. idm, cam, cvm. (default: gmm)", rich_help_panel=TRACKING),
    ] = None,
    update: Annotated[
        str | None,
        typer.Option(help="Measurement update by name, e.g. joint, max_likelihood.", rich_help_panel=TRACKING),
    ] = None,
    particles: Annotated[int | None, typer.Option(help="Particles per vehicle.", rich_help_panel=TRACKING)] = None,
    model_file: Annotated[
        str | None,
        typer.Option(
            help="Model of your own from 'train' (npz), for --model gmm or gmm-short.",
            rich_help_panel=TRACKING,
        ),
    ] = None,
    seed: Annotated[
        int | None,
        typer.Option(help="Root of all randomness: same seed, same results. (default: 0)", rich_help_panel=RESULT),
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option(help="TOML file of settings, e.g. an earlier run's config.toml.", rich_help_panel=RESULT),
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="Any setting by its name in config.toml; repeatable.",
            rich_help_panel=RESULT,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Run folder to write. (default: results/NET-TRACKER-MODEL-TRAFFIC-SEED, with -2, -3, ... where taken)",
            rich_help_panel=RESULT,
        ),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", help="Replace an earlier run in --out.", rich_help_panel=RESULT)
    ] = False,
    video: Annotated[
        Path | None, typer.Option(help="MP4 file to write: the road from above.", rich_help_panel=RESULT)
    ] = None,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print metrics.json on stdout, nothing else there.", rich_help_panel=RESULT)
    ] = False,
    quiet: Annotated[
        bool, typer.Option("--quiet", help="No progress bar and no summary.", rich_help_panel=RESULT)
    ] = False,
) -> None:
    """Drive, sense, track and score once.

    Leaves a run folder: config.toml, manifest.json, truth, detections, tracks
    and errors as parquet, metrics.json, figures, and report.html with all of
    it to look at. Later settings win: defaults, --config, options, --set.

    Examples:
      python -m harness run --net us101
      python -m harness run --density 45 --model cam --seed 3 --out results/cam
      python -m harness run --replay results/cam --model cvm --json
      python -m harness run --replay us101.csv --ego each --duration 120
      python -m harness run --config results/cam/config.toml --set sensor.range_m=80
      python -m harness run --demand us101-0805 --set tracker.options.joint.association.gate_std=4
    """
    from harness.config.layers import resolve_run_config  # noqa: PLC0415

    options = {
        "net": net,
        "density": density,
        "demand": demand,
        "duration": duration,
        "sensor": sensor,
        "replay": None if replay is None else str(replay),
        "format": format_,
        "ego": ego,
        "tracker": tracker,
        "model": model,
        "update": update,
        "particles": particles,
        "model_file": model_file,
        "seed": seed,
    }
    resolved = resolve_run_config(config, options, settings or ())

    from harness.report.figures import draw_figures  # noqa: PLC0415
    from harness.report.page import write_run_page  # noqa: PLC0415
    from harness.report.summary import print_summary  # noqa: PLC0415
    from harness.running.open import check_gui, open_looks  # noqa: PLC0415
    from harness.running.run import Drawing, run  # noqa: PLC0415

    if video is not None:
        from harness.export.video import check_film, write_video  # noqa: PLC0415

        check_film(video, force)
    if gui:
        check_gui(resolved)
    with _only_results_on_stdout():
        finished = run(
            resolved,
            out=out,
            force=force,
            command=shlex.join(["harness", *sys.argv[1:]]),
            quiet=quiet,
            draw=Drawing(draw_figures, write_run_page),
            open_looks=partial(open_looks, gui=gui),
        )
    if video is not None:
        write_video(finished.folder, video, force)
    if not quiet:
        print_summary(finished.metrics, finished.folder)
    if as_json:
        from harness.writing.numbers import as_json as text_of  # noqa: PLC0415

        typer.echo(text_of(finished.metrics), nl=False)


@contextmanager
def _only_results_on_stdout() -> Iterator[None]:
    """Send to stderr what libraries, SUMO's C++ among them, print on stdout."""
    sys.stdout.flush()
    kept = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
