"""``drive``: let the ego drive by what trackers report, and count collisions and hard brakings."""

from harness.closedloop.options import DriveOptions
from harness.commands.from_options import tell_end, typed
from harness.config import options as shared


class Options(DriveOptions, total=False):
    """The options of ``drive``."""

    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> None:
    """Let the ego drive on each perception and count collisions, conflicts and hard brakes.

    In each episode SUMO drives a car for 5 s. Then, for 20 s, the ego's driver
    drives it and sees only its perception; the other vehicles react. All
    perceptions start from the same traffic and the same sensor. Every second
    episode has a provocation. brake: the leader's leader, seen before but
    hidden now, brakes at 5 m/s2. cross: the ego approaches a crossing where a
    hidden car has right of way. stopped: a vehicle in plain view stands in
    the ego's lane. dark: the leader, which is rarely detected, brakes.
    Writes runs.parquet (one row per episode and perception), table.md,
    summary.json, a figure, the folders of episodes with a collision, and a
    page with links to their replays. 'compare' accepts these folders.
    Exit code 3 if an episode failed.

    Examples:
      python -m harness drive --density 45 --perception truth,mmpf,detections
      python -m harness drive --net priority --provoke cross --heed-unseen 0.1
      python -m harness drive --provoke stopped --flow 15 --perception mmpf,pmbm
      python -m harness drive --driver idm --perception mmpf,pmbm --resume
      python -m harness compare 'results/drive@mmpf' 'results/drive@detections'
    """
    from harness.commands.actions.make_drives import make_drives, tell  # noqa: PLC0415

    as_json, quiet = options.pop("json"), options.pop("quiet")
    finished = make_drives(options, typed(), quiet)
    if not quiet:
        tell(finished)
    tell_end(finished.summary, finished.failures, finished.folder, "drives", as_json)
