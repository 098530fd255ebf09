"""The options of a stress test."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TypedDict

from harness.config import options as shared
from harness.config.options import EXECUTION, Option
from harness.grid.worlds import USUAL

GRID = "The grid"


class GridOptions(TypedDict, total=False):
    """The keywords of ``harness.stress``."""

    net: shared.Net
    nets: Annotated[
        str | Sequence[str | Path] | None,
        Option(
            "Several networks in one grid: A,B,C; each at its default density unless --densities is given.", panel=GRID
        ),
    ]
    densities: Annotated[
        str | float | Sequence[float] | None,
        Option("Vehicles per km and lane: START:STOP:STEP (STOP included) or A,B,C. (default: 5:65:10)", panel=GRID),
    ]
    demands: Annotated[
        str | Sequence[str] | None, Option("Named demands instead of densities: A,B,C; see 'nets'.", panel=GRID)
    ]
    replay: Annotated[
        list[Path] | Path | str | None,
        Option("Recorded traffic instead of densities: a file, or a folder of files; repeatable.", panel=GRID),
    ]
    ego: Annotated[
        str | None,
        Option(
            "Recorded vehicles that carry the sensor: each (every vehicle in turn), each:N, auto, or an ID. (default: "
            "each)",
            panel=GRID,
        ),
    ]
    format: Annotated[
        str | None, Option("Format of recorded traffic, as in 'run'; or your own reader, module:function.", panel=GRID)
    ]
    trackers: Annotated[
        str | Sequence[str | Callable[..., Any]],
        Option(
            "Trackers: A,B,C. Settings of one tracker follow its name: mmpf+update=max_likelihood. LABEL= before the "
            "name is how tables call it: paper=mmpf+update=max_likelihood.",
            panel=GRID,
            default="mmpf",
        ),
    ]
    models: Annotated[
        str | Sequence[str] | None, Option("Motion models of mmpf: A,B,C. (default: as in 'run')", panel=GRID)
    ]
    seeds: Annotated[
        str | int | range | Sequence[int] | None,
        Option("Number of seeds, or the range A:B without B. (default: 10; recorded traffic: 1)", panel=GRID),
    ]
    vary: Annotated[
        list[str] | Mapping[str, str | Sequence[float]] | None,
        Option("Vary one more setting, KEY=VALUES; repeatable.", panel=GRID, metavar="KEY=VALUES"),
    ]
    mismatch: Annotated[
        str | Sequence[str] | bool | None,
        Option(
            "Repeat every run with a sensor that differs from its data sheet: A,B,C, all, or no value for the default "
            "set; write one table of the losses. See docs/explanation/statistics.md.",
            panel=GRID,
            metavar="[WORLDS]",
            alone=USUAL,
        ),
    ]
    broken_down: shared.BrokenDown
    hide: shared.Hide
    duration: Annotated[float | None, Option("Scored seconds per run. (default: 60)", panel=GRID)]
    particles: Annotated[int | None, Option("Particles of mmpf per vehicle. (default: 1000)", panel=GRID)]
    sensor: shared.Sensor
    settings: shared.Settings
    out: Annotated[Path | str, Option("Folder to write.", panel=EXECUTION, default=Path("results/stress"))]
    resume: shared.Resume
    retry_failed: shared.RetryFailed
    workers: shared.Workers
    keep: Annotated[
        str | None,
        Option(
            "runs: also keep each run's folder and page in OUT/kept. (default: no)", panel=EXECUTION, metavar="runs"
        ),
    ]
    scheduler: Annotated[
        str | None, Option("Run on this Dask cluster: tcp://host:8786.", panel=EXECUTION, metavar="ADDRESS")
    ]
    timeout_per_run: shared.TimeoutPerRun
