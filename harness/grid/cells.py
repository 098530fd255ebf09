"""The grid of a stress test: cells of shared truth and detections, the runs over each, and their rows."""

from __future__ import annotations

import hashlib
import json
import shlex
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pandas as pd

from harness.common.files import full_disk
from harness.config.layers import leaves
from harness.config.model import DEFAULT_TRACKER, RunConfig, TrackerConfig, TrafficConfig
from harness.config.options import keys_of_options
from harness.running.provenance import model_files
from harness.storage import schema
from harness.storage.grid_folder import TEXT_COLUMNS, Row, flattened

FULL_DISK = "full_disk_errno"
CellTraffic = tuple[TrafficConfig, int, str | None]
"""Settings of traffic, its seed and its recording: cells that agree in them see the same vehicles."""


@dataclass(frozen=True)
class GridPlan:
    """All cells of a stress test.

    Attributes:
        cells: The cells, sorted as their rows are.
        axes: Keys of ``vary``.
        labels: What stands behind the labels of trackers: their names with settings.
    """

    cells: tuple[Cell, ...]
    axes: tuple[str, ...]
    labels: Mapping[str, str] = field(default_factory=dict)

    @property
    def runs(self) -> tuple[PlannedRun, ...]:
        """All runs, in the order of the rows."""
        return tuple(run for cell in self.cells for run in cell.runs)

    @property
    def is_replay(self) -> bool:
        """Whether the traffic was recorded, not simulated."""
        return self.cells[0].config.replay is not None


def labels_markdown(grid: GridPlan) -> str:
    """Return what the labels of trackers mean; nothing where no tracker has one."""
    told = [f"- {label}: `{tracker}`" for label, tracker in grid.labels.items()]
    return "\n".join(["", "## What the labels mean", "", *told, ""]) if told else ""


@dataclass(frozen=True)
class Cell:
    """Runs that share their truth and detections.

    Attributes:
        runs: The runs; net, traffic, sensor and seed are the same in all.
        keep_in: Folder in which each run leaves a run folder of its own; None where only its row is kept.
    """

    runs: tuple[PlannedRun, ...]
    keep_in: Path | None = None

    @property
    def config(self) -> RunConfig:
        """A configuration that traffic and sensor can be opened from."""
        return self.runs[0].config

    @property
    def traffic(self) -> CellTraffic:
        """What cells of the same vehicles agree in."""
        return self.config.traffic, self.config.seed, self.config.replay


@dataclass(frozen=True)
class PlannedRun:
    """One run of the grid.

    Attributes:
        varied: Values of the other axes by key; absent where an axis does not concern the tracker.
        mismatch: Name of the mismatch between what is true and what is believed; None outside a grid of them.
    """

    config: RunConfig
    variant: str
    varied: Mapping[str, float] = field(default_factory=dict)
    mismatch: str | None = None

    @property
    def key(self) -> str:
        """Name of its result file; the same configuration has the same key in every grid."""
        traffic, tracker, replay = self.config.traffic, self.config.tracker, self.config.replay
        demand = f"d{traffic.density:g}" if traffic.density is not None else traffic.demand
        where = Path(replay).stem if replay is not None else demand
        words = [traffic.net, where, f"s{self.config.seed}", tracker.name, tracker.model]
        readable = "-".join(word for word in words if word)
        readable = "".join(letter if letter.isalnum() or letter in "-." else "-" for letter in readable)[-80:]
        content = json.dumps(
            [self.config.as_table(), self.variant, *([self.mismatch] if self.mismatch else [])], sort_keys=True
        )
        return f"{readable.lstrip('-.')}-{hashlib.sha256(content.encode()).hexdigest()[:12]}"

    def identity(self) -> dict[str, Any]:
        """Return the columns that identify this run."""
        traffic, tracker = self.config.traffic, self.config.tracker
        models = [f"{Path(name).name} {digest[:8]}" for name, digest in model_files(self.config).items()]
        return {
            schema.NET: traffic.net,
            schema.DENSITY: traffic.density,
            schema.DEMAND: traffic.demand,
            **({schema.RECORDING: Path(self.config.replay).name} if self.config.replay is not None else {}),
            "tracker": tracker.name,
            "variant": self.variant,
            "model": tracker.model,
            **({schema.MODEL_FILE: models[0]} if models else {}),
            "update": tracker.update,
            schema.SEED: self.config.seed,
            **self.varied,
            **({schema.MISMATCH: self.mismatch} if self.mismatch is not None else {}),
        }


def distinct_trackers(grid: GridPlan) -> Iterator[RunConfig]:
    """Yield one configuration for each distinct tracker with its settings."""
    seen: list[TrackerConfig] = []
    first_seed = grid.cells[0].config.seed
    for run in (run for cell in grid.cells if cell.config.seed == first_seed for run in cell.runs):
        if run.config.tracker not in seen:
            seen.append(run.config.tracker)
            yield run.config


def finished_row(run: PlannedRun, metrics: Mapping[str, Any], total_s: float) -> Row:
    """Return the row of a run that ended well."""
    scores = {name: value for name, value in metrics.items() if name != "run"}
    return {**run.identity(), "succeeded": True, "error": None, "total_s": total_s, **flattened(scores)}


def failed_row(run: PlannedRun, error: str, total_s: float, cause: Exception | None = None) -> Row:
    """Return the row of a run that did not; where a full disk is the cause, it says so and is not to be kept."""
    row = {**run.identity(), "succeeded": False, "error": " ".join(error.split()), "total_s": total_s}
    return row if (full := full_disk(cause)) is None else row | {FULL_DISK: full.errno}


def assemble(grid: GridPlan, rows: Mapping[str, Row]) -> pd.DataFrame:
    """Return the table of a grid, one row for each run in the grid's order, columns in a fixed order."""
    ordered = [rows[run.key] for run in grid.runs]
    metrics = dict.fromkeys(name for row in ordered for name in row)
    identity, outcome = ([column.name for column in columns] for columns in (schema.RUN_IDENTITY, schema.RUN_OUTCOME))
    head = [*identity, *grid.axes, *outcome]
    columns = [*head, *sorted(name for name in metrics if name not in head)]
    table = pd.DataFrame({name: [row.get(name) for row in ordered] for name in columns})
    for name in columns:
        if name in TEXT_COLUMNS:
            table[name] = table[name].astype(object).where(table[name].notna(), None)
        elif name not in ("seed", "succeeded"):
            table[name] = table[name].astype("float64")
    return table


ALWAYS = ("traffic.density", "traffic.demand", "seed")


def command_of(config: RunConfig) -> str:
    """Return the command line that makes this very run again; what is not said in it is the default."""
    default = dict(leaves(RunConfig(tracker=TrackerConfig(name=config.tracker.name)).model_dump()))
    words, option_of = ["python", "-m", "harness", "run"], {key: name for name, key in keys_of_options().items()}
    for key, value in leaves(config.as_table()):
        if key not in ALWAYS and value == (DEFAULT_TRACKER if key == "tracker.name" else default.get(key)):
            continue
        if key in option_of:
            text = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
            words += [f"--{option_of[key].replace('_', '-')}", text]
            continue
        # A text stands for itself that TOML would not read as a number, a truth value or a list.
        is_word = isinstance(value, str) and value.replace("_", "").isalpha()
        plain = is_word and value not in ("true", "false", "nan", "inf")
        words += ["--set", f"{key}={value if plain else json.dumps(value)}"]
    return shlex.join(words)
