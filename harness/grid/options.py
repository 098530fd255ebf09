"""The options of a stress test."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypedDict

from harness.config import options as shared
from harness.config.options import Option, execution

USUAL = "usual"
_grid = partial(Option, panel="The grid")


class GridOptions(TypedDict, total=False):
    """The keywords of ``harness.stress``."""

    net: shared.Net
    nets: Annotated[
        str | Sequence[str | Path] | None,
        _grid("Several networks in one grid: A,B,C; each at its default density unless --densities is given."),
    ]
    densities: Annotated[
        str | float | Sequence[float] | None,
        _grid("Vehicles per km and lane: START:STOP:STEP (STOP included) or A,B,C. (default: 5:65:10)"),
    ]
    demands: Annotated[str | Sequence[str] | None, _grid("Named demands instead of densities: A,B,C; see 'nets'.")]
    replay: Annotated[
        list[Path] | Path | str | None,
        _grid("Recorded traffic instead of densities: a file, or a folder of files; repeatable."),
    ]
    ego: Annotated[
        str | None,
        _grid(
            "Recorded vehicles that carry the sensor: each (every vehicle in turn), each:N, auto, or an ID. (default: "
            "each)"
        ),
    ]
    format: Annotated[
        str | None, _grid("Format of recorded traffic, as in 'run'; or your own reader, module:function.")
    ]
    trackers: Annotated[
        str | Sequence[str | Callable[..., Any]],
        _grid(
            "Trackers: A,B,C. Settings of one tracker follow its name: mmpf+update=max_likelihood. LABEL= before the "
            "name is how tables call it: paper=mmpf+update=max_likelihood.",
            default="mmpf",
        ),
    ]
    models: Annotated[str | Sequence[str] | None, _grid("Motion models of mmpf: A,B,C. (default: as in 'run')")]
    seeds: Annotated[
        str | int | range | Sequence[int] | None,
        _grid("Number of seeds, or the range A:B without B. (default: 10; recorded traffic: 1)"),
    ]
    vary: Annotated[
        list[str] | Mapping[str, str | Sequence[float]] | None,
        _grid("Vary one more setting, KEY=VALUES; repeatable.", metavar="KEY=VALUES"),
    ]
    mismatch: Annotated[
        str | Sequence[str] | bool | None,
        _grid(
            "Repeat every run in worlds that differ from the data sheet: A,B,C, all, or no value for the default "
            "set; write one table of the losses. See docs/explanation/statistics.md.",
            metavar="[WORLDS]",
            alone=USUAL,
        ),
    ]
    broken_down: shared.BrokenDown
    hide: shared.Hide
    duration: Annotated[float | None, _grid("Scored seconds per run. (default: 60)")]
    particles: Annotated[int | None, _grid("Particles of mmpf per vehicle. (default: 1000)")]
    sensor: shared.Sensor
    settings: shared.Settings
    out: Annotated[Path | str, execution("Folder to write.", default=Path("results/stress"))]
    resume: shared.Resume
    retry_failed: shared.RetryFailed
    workers: shared.Workers
    keep: Annotated[
        str | None, execution("runs: also keep each run's folder and page in OUT/kept. (default: no)", metavar="runs")
    ]
    scheduler: Annotated[str | None, execution("Run on this Dask cluster: tcp://host:8786.", metavar="ADDRESS")]
    timeout_per_run: shared.TimeoutPerRun
