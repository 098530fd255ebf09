"""``export``: write a run in another program's format."""

import json
from pathlib import Path
from typing import Annotated, TypedDict

import typer

from harness.common.error_text import drawing
from harness.common.errors import InputError
from harness.common.progress import working
from harness.config import options as shared
from harness.config.options import Option
from harness.storage.manifest import tell_edited


class Options(TypedDict):
    """The options of ``export``."""

    folder: Annotated[
        Path,
        Option(
            "Folder of a finished run; for mlflow and trackio also of a grid.",
            default=...,
            metavar="RUN",
            is_argument=True,
        ),
    ]
    to: Annotated[
        str | None,
        Option(
            "mot, kitti, fcd, csv, rerun, mcap, autoware, osi, scans, mlflow, trackio or module:function.",
            metavar="FORMAT",
        ),
    ]
    video: Annotated[Path | None, Option("Write a top-view video to this MP4 file. (extra: video)")]
    out: Annotated[
        Path | None, Option("Folder to write; for fcd also FILE.xml or FILE.xml.gz. (default: RUN/export/FORMAT)")
    ]
    gzip: Annotated[bool, Option("Compress the files of csv and fcd: .csv.gz, .xml.gz.", default=False)]
    force: Annotated[bool, Option("Replace an existing export or video.", default=False)]
    json: shared.Json


def command(options: Options) -> None:
    """Turn a run into another program's format.

    mot: MOTChallenge text for TrackEval. kitti: tracks of a kitti-tracking
    recording for AB3DMOT's evaluation. fcd: SUMO floating-car data.
    csv: every table. rerun: a recording for the rerun viewer. mcap: a
    recording for Foxglove. autoware: a ROS 2 bag of Autoware's messages.
    osi: ASAM OSI ground truth and sensor data. scans: what a tracker sees.
    mlflow, trackio: metrics, settings and page for an experiment tracker.
    --video: a top-view video.

    Examples:
      python -m harness export results/first --to mot
      python -m harness export results/first --to fcd --out us101.xml.gz
      python -m harness export results/first --video run.mp4
      python -m harness export results/first --to my_format:write
    """
    from harness.export.formats import export_formats, export_run  # noqa: PLC0415

    folder, to, video, force = options["folder"], options["to"], options["video"], options["force"]
    if to is None and video is None:
        raise InputError(
            f"`to`: say which format: {', '.join(export_formats.names())}; or give `video`, for example run.mp4"
        )
    if unused := [name for name in ("out", "gzip") if to is None and options[name]]:
        raise InputError(f"`{unused[0]}`: only `to` uses it; leave it out, or add `to`")
    files: list[Path] = []
    if to is not None:
        with working("exporting", quiet=False):
            files = export_run(
                folder, to, options["out"], force, lambda line: typer.echo(line, err=True), packed=options["gzip"]
            )
    if video is not None:
        with drawing("video"):
            from harness.report.video import write_video  # noqa: PLC0415

            files.append(write_video(folder, video, force, quiet=False))
    tell_edited(folder, "folder")
    if options["json"]:
        typer.echo(json.dumps({"files": [str(file) for file in files]}))
        return
    for file in files:
        typer.echo(file, err=True)
