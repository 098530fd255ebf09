"""The grid that the options of a stress test ask for."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from harness.common.error_text import shown
from harness.common.errors import InputError
from harness.config.lists import MOST_VALUES
from harness.config.model import brings_its_own_demand
from harness.config.options import setting_of, setting_words
from harness.grid.grid import GridRequest
from harness.grid.options import USUAL
from harness.truth.recorded.detected.av2 import argoverse_logs
from harness.truth.recorded.detected.kitti import LABELS
from harness.truth.recorded.fcd import declares_types


def request_of(options: Mapping[str, Any]) -> GridRequest:
    """Return the grid that checked options describe."""
    files = _files_of(options["replay"])
    net = options["net"]
    nets = _listed(options["nets"])
    given = options["densities"] is not None or options["demands"] is not None or bool(files)
    own_demand = nets is not None or brings_its_own_demand(net or "us101")
    return GridRequest(
        net=net if files or nets is not None else net or "us101",
        densities=_listed(options["densities"]) if given or own_demand else "5:65:10",
        demands=_listed(options["demands"]),
        models=_listed(options["models"]),
        trackers=_listed(options["trackers"], _tracker_path) or "",
        seeds=_seeds(options["seeds"]) or ("1" if files else "10"),
        duration_s=options["duration"],
        particles=options["particles"],
        sensor=options["sensor"],
        settings=(
            *setting_of("traffic.broken_down", options["broken_down"]),
            *setting_of("altered.hide_s", options["hide"]),
            *setting_words(options["settings"]),
            *setting_of("traffic.recording.format", options["format"]),
        ),
        vary=tuple(_axes(options["vary"])),
        replay=tuple(map(str, files)),
        ego=options["ego"],
        mismatch=_worlds(options["mismatch"]),
        nets=nets,
    )


def _worlds(asked: object) -> bool | str:
    """Return the requested worlds; True for the default ones, False for none."""
    if asked is None or isinstance(asked, bool):
        return bool(asked)
    listed = _listed(asked) or ""
    return True if listed == USUAL else listed


def _listed(values: object, as_text: Callable[[Any], str] = str) -> str | None:
    """Return a list as it is typed, with commas between."""
    if values is None or isinstance(values, str):
        return values
    return ",".join(map(as_text, values if isinstance(values, Sequence) else [values]))


def _seeds(seeds: object) -> str | None:
    """Return seeds as they are typed: a number of them, or ``A:B``."""
    if not isinstance(seeds, Sequence) or isinstance(seeds, str):
        return None if seeds is None else str(seeds)
    first = seeds[: MOST_VALUES + 1]  # more are refused for their number
    whole = first and all(isinstance(seed, int) and not isinstance(seed, bool) for seed in first)
    if not whole or list(first) != list(range(first[0], first[0] + len(first))):
        raise InputError(f"`seeds`: give seeds that follow each other, such as range(0, 10), not {shown(list(first))}")
    return f"{first[0]}:{first[0] + len(first)}"


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
            f"`trackers`: worker processes can't import {name or tracker!r}; put it into a separate module and give "
            "'module:name'"
        )
    return f"{module}:{name}"


def _files_of(replay: Sequence[Path | str] | Path | str | None) -> list[Path]:
    """Return the files of recorded traffic; of a folder that is no recording itself, all that it holds."""
    files: list[Path] = []
    for given in map(Path, [replay] if isinstance(replay, (str, Path)) else replay or ()):
        path = given / LABELS if (given / LABELS).is_dir() else given
        if logs := argoverse_logs(path):
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
