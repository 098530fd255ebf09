"""``score``: score a tracker's log against truth, both from any source."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from harness.commands.from_options import typed
from harness.common.numbers import as_json as text_of
from harness.common.progress import working
from harness.config import options as shared
from harness.config.options import Option
from harness.report.folder_page import write_page
from harness.report.summary import print_summary
from harness.running.logged import Logs, score_logs


class Options(Logs):
    """The options of ``score``."""

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
    command_line = typed()
    with working("scoring", quiet):
        folder, metrics, report, left_out = score_logs(options, out, force, command_line, write_page)
    if left_out or not quiet:
        typer.echo(report, err=True)
    if not quiet:
        print_summary(metrics, folder, is_log=True)
    if as_json:
        typer.echo(text_of(metrics), nl=False)
