"""``stress``: a grid of runs over density, seeds, trackers, models and any other setting."""

import sys

from harness.commands.from_options import tell_end, typed
from harness.common.markdown import show_markdown
from harness.config import options as shared
from harness.grid.options import GridOptions


class Options(GridOptions, total=False):
    """The options of ``stress``."""

    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> None:
    """Run many densities, trackers, models and seeds to find the limits of each.

    All trackers get the same truth and detections for a given density and
    seed. Writes runs.parquet (one row per run, including failed runs),
    summary.json, table.md, figures and a page with links to each run.
    Exit code 3 if a run failed.
    Recorded traffic gives one table over all files instead of curves.
    --nets runs several networks in one grid and reports scores per network.
    Each network uses its default density unless --densities or --demands is
    given.
    --mismatch repeats every run in worlds that differ from the data sheet:
    reported deviations halved and doubled, 30 % of detections missed, five
    times the clutter, drifting noise, and bursts of misses. One table lists
    the loss of each tracker. --mismatch all and --mismatch A,B,C
    choose other changes, such as dark,posts,ego-jitter. With --replay the
    recorded detections are altered; the sensor is not simulated again.

    Examples:
      python -m harness stress --models gmm,idm,cvm,cam --seeds 10
      python -m harness stress --trackers mmpf,mmpf+update=max_likelihood,pmbm
      python -m harness stress --densities 30 --vary sensor.range_m=40:160:20
      python -m harness stress --densities 20,40 --duration 20 --resume
      python -m harness stress --densities 20,45 --seeds 3 --keep runs
      python -m harness stress --nets us101,curve,junction --seeds 5
      python -m harness stress --nets curve,junction --demands light,heavy
      python -m harness stress --densities 20,45 --mismatch --trackers mmpf,pmbm
      python -m harness stress --replay RUN --mismatch all --trackers mmpf,pmbm
      python -m harness stress --replay FOLDER --trackers mmpf,stonesoup-jpda
      python -m harness stress --replay kitti/label_02 --format kitti-tracking
      python -m harness stress --scheduler tcp://host:8786
    """
    from harness.api import make_grid  # noqa: PLC0415

    as_json, quiet = options.pop("json"), options.pop("quiet")
    finished = make_grid(options, typed(), quiet)
    if not quiet and (finished.summary["grid"]["replay"] or finished.summary["grid"]["mismatch"]):
        show_markdown((finished.folder / "table.md").read_text(encoding="utf-8"), on_stderr=True)
    elif not quiet:
        from harness.analysis.tables import print_result  # noqa: PLC0415

        print_result(finished.title, finished.points, finished.breaks, finished.failures, str(finished.folder))
    if not quiet:
        sys.stderr.write(f"Open in a browser: {finished.folder / 'report.html'}\n")
    tell_end(finished.summary, finished.failures, finished.folder, "runs", as_json)
