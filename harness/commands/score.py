"""``score``: score a tracker's log against truth, both from any source."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import Annotated, TypedDict

import typer

from harness.common.numbers import as_json as text_of
from harness.config import options as shared
from harness.config.options import Option
from harness.report.folder_page import write_page
from harness.report.summary import print_summary
from harness.running.logged import Logs, score_logs


class Options(TypedDict):
    """The options of ``score``."""

    truth: Annotated[Path, Option("Truth: a run's folder, or a file or folder of a format.", default=...)]
    tracks: Annotated[Path, Option("Tracks that a tracker reported.", default=...)]
    detections: Annotated[
        Path | None, Option("Detections that the tracker got. (default: the true positions in view)", metavar="PATH")
    ]
    ego: Annotated[
        str | None,
        Option("Vehicle that carries the sensor, or a file of its poses. (default: the column is_ego)", metavar="NAME"),
    ]
    format: Annotated[
        str | None,
        Option("parquet, csv, kitti, mot, nuscenes or mcap. (default: by the content)", metavar="FORMAT"),
    ]
    step: Annotated[
        float, Option("Seconds between frames that have only a number.", default=0.1, metavar="SECONDS", least=0.001)
    ]
    sensor: Annotated[str | None, Option("Sensor profile whose range and field of view are used.")]
    settings: Annotated[
        list[str] | None, Option("A setting of the sensor; repeatable.", flag="--set", metavar="sensor.KEY=VALUE")
    ]
    seed: Annotated[int, Option("Seed of the bootstrap intervals; with a run's truth, the run's.", default=0, least=0)]
    name: Annotated[str | None, Option("What the tracker is called. (default: the file's name)")]
    out: Annotated[Path | None, Option("Folder to write. (default: a new one in results/)")]
    force: Annotated[bool, Option("Replace an earlier run in --out.", default=False)]
    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> None:
    """Score a tracker's log against a truth, both of any origin.

    Write a run folder as 'run' does; report, compare and export accept it.
    Formats: this project's tables (truth.parquet, tracks.csv, ...), KITTI's
    tracking text, MOTChallenge in the plane, nuScenes' JSON, MCAP. If no file
    has the visible fraction of each vehicle, it is computed from the boxes.

    Examples:
      python -m harness score --truth results/cam --tracks tracks.csv
      python -m harness score --truth label_02 --tracks my_tracks --ego oxts_poses
      python -m harness score --truth truth.parquet --tracks log.mcap:/tracks
    """
    as_json, quiet, out, force = options["json"], options["quiet"], options["out"], options["force"]
    logs = Logs(
        truth=options["truth"],
        tracks=options["tracks"],
        detections=options["detections"],
        ego=options["ego"],
        format=options["format"],
        step=options["step"],
        sensor=options["sensor"],
        settings=options["settings"] or [],
        seed=options["seed"],
        name=options["name"],
    )
    folder, metrics, report = score_logs(logs, out, force, shlex.join(["harness", *sys.argv[1:]]), write_page)
    if not quiet:
        typer.echo(report, err=True)
        print_summary(metrics, folder)
    if as_json:
        typer.echo(text_of(metrics), nl=False)
