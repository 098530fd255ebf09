"""``bench``: how long trackers take."""

from pathlib import Path
from typing import Annotated, TypedDict

from harness.common.errors import InputError
from harness.config import options as shared
from harness.config.options import Option, options_of


class Options(TypedDict):
    """The options of ``bench``."""

    vehicles: Annotated[
        str | None,
        Option("Numbers of vehicles in range, separated by commas. (default: 10,25,50,100,200; with --against 50)"),
    ]
    trackers: Annotated[
        str | None,
        Option(
            "Trackers, separated by commas: mmpf:MODEL, stonesoup-gnn, ... "
            "(default: mmpf with residual, gmm and cvm, and Stone Soup's; with --against mmpf:residual)"
        ),
    ]
    against: Annotated[
        str | None, Option("Git revision: compare the processor times of steps with it, in turns.", metavar="REVISION")
    ]
    particles: Annotated[int, Option("Particles per vehicle.", default=1000, least=10, most=1_000_000)]
    steps: Annotated[int, Option("Scans per scene.", default=40, least=8, most=100_000)]
    budget: Annotated[
        float, Option("Largest CPU time in seconds per tracker and number of vehicles.", default=10.0, least=0.1)
    ]
    seed: shared.Seed
    out: Annotated[Path, Option("Folder for bench.json.", default=Path("results/bench"))]
    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> int:
    """Measure the time per step and stage for increasing numbers of vehicles.

    All trackers process the same detections, in turn, in one process.
    With --against, the current code and that of the revision take turns,
    scan by scan, in two processes; exit code 1 if a step is slower.

    Examples:
      python -m harness bench
      python -m harness bench --trackers mmpf:gmm,mmpf:idm --vehicles 50,200
      python -m harness bench --against HEAD~1
    """
    if options["against"] is not None and options["budget"] != options_of(Options)["budget"].option.default:
        raise InputError("`budget`: with `against` each tracker makes all steps; leave it out")
    from harness.commands.actions.measure import measure  # noqa: PLC0415

    return measure(options)
