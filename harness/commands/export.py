"""``export``: turn a run into another program's format."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="Folder of a finished run.")],
    to: Annotated[str | None, typer.Option(help="mot, fcd, csv, rerun or osi.")] = None,
    video: Annotated[Path | None, typer.Option(help="MP4 file to write: the road from above.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder to write. (default: RUN/export/FORMAT)")] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace what is there.")] = False,
    as_json: Annotated[
        bool, typer.Option("--json", help="Print the written files as JSON on stdout, nothing else there.")
    ] = False,
) -> None:
    """Turn a run into another program's format.

    mot: MOTChallenge text, as TrackEval reads it. fcd: SUMO floating-car
    data. csv: every table. rerun: a recording for the rerun viewer. osi: ASAM
    OSI ground truth and sensor data. --video: the scene as a film.

    Examples:
      python -m harness export results/us101-mmpf-gmm-d20-s0 --to mot
      python -m harness export results/us101-mmpf-gmm-d20-s0 --video run.mp4
    """
    from harness.errors import InputError  # noqa: PLC0415
    from harness.export.formats import FORMATS, export_run  # noqa: PLC0415

    if to is None and video is None:
        raise InputError(f"`to`: say which format: {', '.join(FORMATS)}; or give `video`, for example run.mp4")
    files = export_run(folder, to, out, force) if to is not None else []
    if video is not None:
        from harness.export.video import write_video  # noqa: PLC0415

        files.append(write_video(folder, video, force))
    if as_json:
        typer.echo(json.dumps({"files": [str(file) for file in files]}))
        return
    for file in files:
        print(file, file=sys.stderr)  # noqa: T201
