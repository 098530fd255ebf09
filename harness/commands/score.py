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
        Path | None, Option("What the tracker was shown. (default: where every vehicle in view is)", metavar="PATH")
    ]
    ego: Annotated[
        str | None,
        Option("Vehicle that carries the sensor, or a file of its poses. (default: what is_ego says)", metavar="NAME"),
    ]
    format: Annotated[
        str | None,
        Option("parquet, csv, kitti, mot, nuscenes or mcap. (default: recognised of each file)", metavar="FORMAT"),
    ]
    step: Annotated[
        float, Option("Seconds between frames that are only counted.", default=0.1, metavar="SECONDS", least=0.001)
    ]
    sensor: Annotated[str | None, Option("Sensor profile whose reach and view decide what was hidden.")]
    settings: Annotated[
        list[str] | None, Option("A setting of the sensor; repeatable.", flag="--set", metavar="sensor.KEY=VALUE")
    ]
    seed: Annotated[
        int, Option("Root of the intervals' randomness; of a run's truth the run's own.", default=0, least=0)
    ]
    name: Annotated[str | None, Option("What the tracker is called. (default: the file's name)")]
    out: Annotated[Path | None, Option("Folder to write. (default: a new one in results/)")]
    force: Annotated[bool, Option("Replace an earlier run in --out.", default=False)]
    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> None:
    """Score a tracker's log against a truth, both of any origin.

    Leaves a run folder like that of 'run': report, compare and export take it.
    Formats: this project's tables (truth.parquet, tracks.csv, ...), KITTI's
    tracking text, MOTChallenge in the plane, nuScenes' JSON, MCAP. What of
    each vehicle was hidden is worked out from the boxes if no file says it.

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
