"""What experiment trackers are told of the runs in a run's or a grid's folder."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

from harness.common.files import write_text
from harness.common.untrusted_files import read_json
from harness.storage import run_folder as runfolder
from harness.storage.grid_folder import GRID, RUNS, TEXT_COLUMNS, flattened
from harness.storage.schema import DENSITY, SEED

PAGE, REGISTER = "report.html", "logged.json"


@dataclass(frozen=True)
class LoggedRun:
    """A run as an experiment tracker holds it.

    Attributes:
        metrics: Its finite numbers by their keys in ``metrics.json``.
        tags: What tells it from others: network, density, tracker, seed and so on.
        settings: What was set, by the setting's name.
    """

    name: str
    metrics: Mapping[str, float]
    tags: Mapping[str, str]
    settings: Mapping[str, str]

    @classmethod
    def of(cls, values: Mapping[str, Any], about: Mapping[str, Any], settings: Mapping[str, Any]) -> Self:
        """Return the run of numbers and texts, of which missing ones are left out."""
        numbers = {
            key: float(value)
            for key, value in values.items()
            if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        }
        tags = {key: f"{value:g}" if isinstance(value, float) else str(value) for key, value in about.items()}
        tags = {key: value for key, value in tags.items() if value not in ("None", "nan", "")}
        words = (tags[key] for key in ("net", "variant", "tracker", "model", DENSITY) if key in tags)
        name = f"{'-'.join(dict.fromkeys(words))}-s{tags.get(SEED, '')}"
        return cls(name, numbers, tags, {key: str(value) for key, value in settings.items()})


def logged_runs(folder: Path) -> list[LoggedRun]:
    """Return the runs of a folder: of a grid each row, with its error as a tag if it failed; else the run itself."""
    if not (folder / RUNS).is_file():
        runfolder.read_manifest(folder, "folder")
        flat = flattened(runfolder.read_metrics(folder, "folder"))
        about = {key.removeprefix("run."): flat.pop(key) for key in list(flat) if key.startswith("run.")}
        return [LoggedRun.of(flat, about, flattened(runfolder.read_config_table(folder, "folder")))]
    asked = flattened(read_json(folder / GRID, "folder")) if (folder / GRID).is_file() else {}
    asked = {key: value for key, value in asked.items() if value is not None}
    rows = runfolder.read_table(folder, RUNS, "folder", (SEED, "succeeded")).to_dict("records")
    axes = {word.partition("=")[0] for key, word in asked.items() if key.startswith("vary.")}
    told = TEXT_COLUMNS | {DENSITY, SEED, "succeeded"} | axes
    runs = [
        LoggedRun.of(
            {str(key): value for key, value in row.items() if key not in told},
            {str(key): value for key, value in row.items() if key in told},
            asked,
        )
        for row in rows
    ]
    # What else was varied need not be in a name, but a name is of one run.
    earlier = [sum(other.name == run.name for other in runs[:place]) for place, run in enumerate(runs)]
    return [replace(run, name=f"{run.name}-{n + 1}") if n else run for run, n in zip(runs, earlier, strict=True)]


def files_in(folder: Path) -> list[Path]:
    """Return the files that an export has written into its folder, without those of this program's own."""
    return sorted(path for path in folder.rglob("*") if path.is_file() and path.name[0] != ".")


def register(folder: Path, store: str, runs: Mapping[str, str]) -> Path:
    """Write down in which store the runs are, and under which ids, and return the file."""
    write_text(folder / REGISTER, json.dumps({"store": store, "runs": runs}, indent=2))
    return folder / REGISTER
