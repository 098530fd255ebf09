"""``drive``: let the ego drive by what trackers tell it, and see what becomes of it."""

from __future__ import annotations

import json
import shlex
import sys

import typer

from harness.closedloop.options import DriveOptions
from harness.common.errors import RunError
from harness.config import options as shared


class Options(DriveOptions, total=False):
    """The options of ``drive``."""

    json: shared.Json
    quiet: shared.Quiet


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
      python -m harness drive --density 45 --perception truth,mmpf,detections
      python -m harness drive --net priority --provoke cross --heed-unseen 0.1
      python -m harness drive --provoke stopped --flow 15 --perception mmpf,pmbm
      python -m harness drive --driver idm --perception mmpf,stonesoup-jpda --resume
      python -m harness compare 'results/drive@mmpf' 'results/drive@detections'
    """
    from harness.commands.actions.make_drives import make_drives, tell  # noqa: PLC0415

    as_json, quiet = options.pop("json"), options.pop("quiet")
    finished = make_drives(options, shlex.join(["harness", *sys.argv[1:]]), quiet)
    if not quiet:
        tell(finished)
    if as_json:
        typer.echo(json.dumps(finished.summary, indent=2))
    if finished.failures:
        raise RunError(
            f"{len(finished.failures)} of {finished.summary['runs']} drives failed, the first: "
            f"{finished.failures[0]}; all rows are in {finished.folder}"
        )
