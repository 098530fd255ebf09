"""``bench``: how long trackers take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypedDict

from harness.config import options as shared
from harness.config.options import Option


class Options(TypedDict):
    """The options of ``bench``."""

    vehicles: Annotated[str, Option("Numbers of vehicles in range, with commas between.", default="10,25,50,100,200")]
    trackers: Annotated[
        str | None,
        Option(
            "Trackers with commas between: mmpf:MODEL, stonesoup-gnn, stonesoup-gnn:coarse, ... "
            "(default: mmpf with residual, gmm and cvm, and Stone Soup's)"
        ),
    ]
    particles: Annotated[int, Option("Particles per vehicle.", default=1000, least=10)]
    steps: Annotated[int, Option("Scans of each scene.", default=40, least=8)]
    budget: Annotated[
        float, Option("Processor seconds that a tracker has for each number of vehicles.", default=10.0, least=0.1)
    ]
    seed: shared.Seed
    out: Annotated[Path, Option("Folder of bench.json.", default=Path("results/bench"))]
    json: shared.Json
    quiet: shared.Quiet


def command(options: Options) -> None:
    """Measure how long a step takes by stage, over more and more vehicles.

    All trackers take in the same detections in turns, in one process.

    Examples:
      python -m harness bench
      python -m harness bench --trackers mmpf:gmm,mmpf:idm --vehicles 50,200
    """
    from harness.commands.actions.measure import measure  # noqa: PLC0415

    measure(options)
