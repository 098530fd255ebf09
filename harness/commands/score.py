"""``score``: score a tracker's log against truth, both from any source."""

from pathlib import Path
from typing import Annotated

from harness.config import options as shared
from harness.config.options import Option
from harness.running.log_options import Logs


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
    from harness.commands.actions.score_log import score_log  # noqa: PLC0415

    score_log(options)
