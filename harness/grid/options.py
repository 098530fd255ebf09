"""The options of a stress test, each declared once, and the grid that they ask for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypedDict

from harness.common.errors import InputError
from harness.config.options import Option, setting_words
from harness.grid.worlds import USUAL

if TYPE_CHECKING:
    from harness.grid.grid import GridRequest

GRID, RESULT = "The grid", "How it is run"


class GridOptions(TypedDict, total=False):
    """The keywords of ``harness.stress``."""

    net: Annotated[
        str | Path | None,
        Option("Network by name, or your own: a folder or .sumocfg file. (default: us101)", panel=GRID),
    ]
    nets: Annotated[
        str | Sequence[str | Path] | None,
        Option("Several networks in one grid: A,B,C; each at its middle density unless one is given.", panel=GRID),
    ]
    densities: Annotated[
        str | float | Sequence[float] | None,
        Option("Vehicles per km and lane: START:STOP:STEP, ends included, or A,B,C. (default: 5:65:10)", panel=GRID),
    ]
    demands: Annotated[
        str | Sequence[str] | None, Option("Named demands in place of densities: A,B,C; see 'nets'.", panel=GRID)
    ]
    replay: Annotated[
        list[Path] | Path | str | None,
        Option("Recorded traffic in place of densities: a file, or a folder of files; repeatable.", panel=GRID),
    ]
    ego: Annotated[
        str | None,
        Option(
            "Recorded vehicles that carry the sensor: each in turn, each:N, auto, or an ID. (default: each)",
            panel=GRID,
        ),
    ]
    format: Annotated[
        str | None,
        Option("Format of recorded traffic, as in 'run'; or your own reader, module:function.", panel=GRID),
    ]
    trackers: Annotated[
        str | Sequence[str | Callable[..., Any]],
        Option("Trackers: A,B,C; with settings of its own: mmpf+update=max_likelihood.", panel=GRID, default="mmpf"),
    ]
    models: Annotated[
        str | Sequence[str] | None, Option("Motion models of mmpf: A,B,C. (default: as in 'run')", panel=GRID)
    ]
    seeds: Annotated[
        str | int | range | Sequence[int] | None,
        Option("How many seeds, or seeds A:B, B excluded. (default: 10; recorded traffic: 1)", panel=GRID),
    ]
    vary: Annotated[
        list[str] | Mapping[str, str | Sequence[float]] | None,
        Option("One more axis; repeatable.", panel=GRID, metavar="KEY=VALUES"),
    ]
    mismatch: Annotated[
        str | Sequence[str] | bool | None,
        Option(
            "Every run in worlds that are not as believed: A,B,C, all, or none named for the usual ones; one table of "
            "what each costs. See docs/comparing.md.",
            panel=GRID,
            metavar="[WORLDS]",
            alone=USUAL,
        ),
    ]
    broken_down: Annotated[
        int | None,
        Option("Vehicles that stand broken down in main lanes, as in 'run'. (default: 0)", panel=GRID, metavar="N"),
    ]
    duration: Annotated[float | None, Option("Scored seconds of each run. (default: 60)", panel=GRID)]
    particles: Annotated[int | None, Option("Particles per vehicle, for mmpf.", panel=GRID)]
    sensor: Annotated[
        str | None,
        Option("Profile: lidar, radar, camera, ..., or module:profile; see 'settings'. (default: lidar)", panel=GRID),
    ]
    settings: Annotated[
        list[str] | Mapping[str, object] | None,
        Option("Any setting of config.toml for all runs.", panel=GRID, flag="--set", metavar="KEY=VALUE"),
    ]
    out: Annotated[Path | str, Option("Folder to write.", panel=RESULT, default=Path("results/stress"))]
    resume: Annotated[bool, Option("Keep the runs that --out holds, make the others.", panel=RESULT, default=False)]
    retry_failed: Annotated[bool, Option("Like --resume, and make failed runs again.", panel=RESULT, default=False)]
    workers: Annotated[int | None, Option("Worker processes. (default: one per core)", panel=RESULT, least=1)]
    keep: Annotated[
        str | None,
        Option("runs: leave the folder and page of every run too, in OUT/kept.", panel=RESULT, metavar="runs"),
    ]
    scheduler: Annotated[
        str | None, Option("Run on this Dask cluster instead: tcp://host:8786.", panel=RESULT, metavar="ADDRESS")
    ]
    timeout_per_run: Annotated[float | None, Option("Seconds after which a run is given up.", panel=RESULT, least=0.1)]


def request_of(options: Mapping[str, Any]) -> GridRequest:
    """Return the grid that checked options ask for.

    Raises:
        InputError: A list is not one that a grid can be made of.
    """
    from harness.config.model import brings_its_own_demand  # noqa: PLC0415
    from harness.grid.grid import GridRequest  # noqa: PLC0415

    files = _files_of(options["replay"])
    net = options["net"]
    nets = _listed(options["nets"])
    given = options["densities"] is not None or options["demands"] is not None or bool(files)
    own_demand = nets is not None or brings_its_own_demand(net or "us101")
    return GridRequest(
        net=net if files or nets is not None else net or "us101",
        densities=_listed(options["densities"]) if given or own_demand else "5:65:10",
        demands=_listed(options["demands"]),
        trackers=_listed(options["trackers"], _tracker_path) or "",
        models=_listed(options["models"]),
        seeds=_seeds(options["seeds"]) or ("1" if files else "10"),
        duration_s=options["duration"],
        particles=options["particles"],
        sensor=options["sensor"],
        settings=(
            *_setting("traffic.broken_down", options["broken_down"]),
            *setting_words(options["settings"]),
            *_setting("traffic.recording.format", options["format"]),
        ),
        vary=tuple(_axes(options["vary"])),
        replay=tuple(map(str, files)),
        ego=options["ego"],
        mismatch=_worlds(options["mismatch"]),
        nets=nets,
    )


def _worlds(asked: object) -> bool | str:
    """Return the worlds that are asked for; True for the usual ones, False for none."""
    if asked is None or isinstance(asked, bool):
        return bool(asked)
    listed = _listed(asked) or ""
    return True if listed == USUAL else listed


def _setting(key: str, value: object) -> list[str]:
    return setting_words({key: value}) if value is not None else []


def _listed(values: object, as_text: Callable[[Any], str] = str) -> str | None:
    """Return a list as it is typed, with commas between."""
    if values is None or isinstance(values, str):
        return values
    return ",".join(map(as_text, values if isinstance(values, Sequence) else [values]))


def _seeds(seeds: object) -> str | None:
    """Return seeds as they are typed: a number of them, or ``A:B``."""
    if not isinstance(seeds, Sequence) or isinstance(seeds, str):
        return None if seeds is None else str(seeds)
    if not seeds or list(seeds) != list(range(seeds[0], seeds[0] + len(seeds))):
        raise InputError(f"`seeds`: give seeds that follow each other, for example range(0, 10), not {list(seeds)}")
    return f"{seeds[0]}:{seeds[-1] + 1}"


def _axes(vary: Sequence[str] | Mapping[str, object] | None) -> list[str]:
    if isinstance(vary, Mapping):
        return [f"{key}={_listed(values)}" for key, values in vary.items()]
    return list(vary or ())


def _tracker_path(tracker: object) -> str:
    """Return a tracker's name; of a function the ``module:name`` by which another process finds it."""
    if isinstance(tracker, str):
        return tracker
    module, name = getattr(tracker, "__module__", "__main__"), getattr(tracker, "__qualname__", "")
    if module == "__main__" or not name.isidentifier():
        raise InputError(
            f"`trackers`: worker processes can't find {name or tracker!r}; put it into a module of its own and give "
            "'module:name'"
        )
    return f"{module}:{name}"


def _files_of(replay: Sequence[Path | str] | Path | str | None) -> list[Path]:
    """Return the files of recorded traffic; of a folder that is no recording itself, all that it holds."""
    from harness.truth.recorded.detected.av2 import argoverse_logs  # noqa: PLC0415
    from harness.truth.recorded.fcd import declares_types  # noqa: PLC0415

    files: list[Path] = []
    for path in map(Path, [replay] if isinstance(replay, (str, Path)) else replay or ()):
        logs = argoverse_logs(path)
        if logs:
            files += logs
        elif path.is_dir() and not any(path.glob("*_tracks.csv")) and not (path / "manifest.json").is_file():
            inside = sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))
            inside = [file for file in inside if not declares_types(file)]
            if not inside:
                raise InputError(f"`replay`: {path} has no files; give files of recorded traffic, or their folder")
            files += inside
        else:
            files.append(path)
    return files
