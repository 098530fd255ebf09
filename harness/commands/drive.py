"""``drive``: let the ego drive by what trackers tell it, and see what becomes of it."""

from __future__ import annotations

import json
import os
import shlex
import sys
from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated

import typer

from harness.closedloop.options import RESULT, DriveOptions, request_of
from harness.config.options import Option, checked

if TYPE_CHECKING:
    from harness.closedloop.drive import FinishedDrives


class Options(DriveOptions, total=False):
    """The options of ``drive``."""

    json: Annotated[bool, Option("Print summary.json on stdout, nothing else there.", panel=RESULT, default=False)]
    quiet: Annotated[bool, Option("No progress bar and no tables.", panel=RESULT, default=False)]


def command(options: Options) -> None:
    """Let the ego drive by what each belief tells it; count what it costs.

    Each episode follows a car for 5 s while SUMO drives it, then hands it
    over for 20 s to a driver that knows only the belief; the others react.
    All beliefs begin with the same traffic and the same sensor. In every
    second episode the leader's leader, hidden from the sensor at that moment
    but seen before, brakes at 5 m/s2; or, with --provoke cross, the ego comes up
    to a crossing where a hidden car has right of way over it; or, in plain view,
    a vehicle stands in its lane (stopped), or its leader, which is seldom
    detected, brakes (dark).
    Leaves runs.parquet (one row per episode and belief), table.md,
    summary.json, a figure, the folders of episodes that ended in a collision
    and a page that leads to their replays. 'compare' takes such folders.
    Exit code 3 if a drive failed.

    Examples:
      python -m harness drive --density 45 --beliefs truth,mmpf,detections
      python -m harness drive --net priority --provoke cross --heed-unseen 0.1
      python -m harness drive --provoke stopped --flow 15 --beliefs mmpf,pmbm
      python -m harness drive --driver idm --beliefs mmpf,stonesoup-jpda --resume
      python -m harness compare 'results/drive@mmpf' 'results/drive@detections'
    """
    from harness.common.errors import RunError  # noqa: PLC0415

    as_json, quiet = options.pop("json"), options.pop("quiet")
    finished = make_drives(options, shlex.join(["harness", *sys.argv[1:]]), quiet)
    if not quiet:
        from harness.common.markdown import show_markdown  # noqa: PLC0415

        show_markdown(finished.text, on_stderr=True)
        sys.stderr.write(f"{finished.folder}\n")
    if as_json:
        typer.echo(json.dumps(finished.summary, indent=2))
    if finished.failures:
        raise RunError(
            f"{len(finished.failures)} of {finished.summary['runs']} drives failed, the first: "
            f"{finished.failures[0]}; all rows are in {finished.folder}"
        )


def make_drives(options: Mapping[str, object], command: str, quiet: bool) -> FinishedDrives:
    """Drive, and write the folder and its pages.

    Args:
        options: Options by name, as ``DriveOptions`` has them.
        command: What the manifest says of how it was called.
        quiet: Whether to leave out the progress bar.

    Raises:
        InputError: An option or the folder is wrong; nothing was driven.
    """
    values = checked(DriveOptions, options, "drive")
    request = request_of(values)
    # Only now: what is wrong with the input is told before anything heavy is imported.
    from harness.closedloop.drive import Execution, run_drives  # noqa: PLC0415
    from harness.grid.making import on_stderr  # noqa: PLC0415

    workers = values["workers"] or os.cpu_count() or 1
    how = Execution(workers, values["timeout_per_run"], values["resume"], values["retry_failed"])
    finished = run_drives(request, values["out"], how, on_stderr(quiet), command)
    _write_pages(finished, quiet)
    return finished


def _write_pages(finished: FinishedDrives, quiet: bool) -> None:
    """Write the pages of the collisions that the tables lead to, as far as they are not there, then the folder's."""
    from harness.common.progress import progress_bar  # noqa: PLC0415
    from harness.report.folderpage import write_page  # noqa: PLC0415
    from harness.report.page import PAGE, write_run_page  # noqa: PLC0415
    from harness.storage import run_folder as runfolder  # noqa: PLC0415
    from harness.storage.grid_folder import KEPT  # noqa: PLC0415

    folders = [finished.folder / KEPT / key for key in finished.shown]
    with progress_bar("pages of the collisions", len(folders), quiet) as advance:
        for folder in folders:
            if (folder / runfolder.MANIFEST).is_file() and not (folder / PAGE).is_file():
                write_run_page(folder)
            advance()
    write_page(finished.folder)
