"""What is compared: the rows of a run folder or of a stress folder, or of one tracker of it."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pandas as pd
from pandas.api.types import is_numeric_dtype

from harness.analysis.curves import labelled
from harness.analysis.verdicts import compared_quantities
from harness.common.errors import InputError
from harness.scoring.metrics.closedloop import COLLIDED
from harness.storage import run_folder as runfolder
from harness.storage.grid_folder import GRID, RUNS
from harness.storage.grid_rows import flattened
from harness.storage.schema import MISMATCH, RECORDING

STANDARD = "standard"
SETTING = ("net", "density", "demand")


@dataclass(frozen=True)
class Source:
    """One side of a comparison.

    Attributes:
        name: What the user typed.
        folder: Where it lies.
        rows: One row per successful run, with a column ``label``.
        failed: Number of runs that failed.
        is_run: Whether it is a single run's folder.
        axes: Columns that were varied beside density, demand and seed, the mismatch among them.
    """

    name: str
    folder: Path
    rows: pd.DataFrame
    failed: int
    is_run: bool
    axes: tuple[str, ...] = ()

    @property
    def labels(self) -> list[str]:
        """The trackers, with their settings and models."""
        return list(dict.fromkeys(self.rows["label"]))

    @property
    def is_closed_loop(self) -> bool:
        """Whether its runs are drives by belief (``harness.closedloop``)."""
        return COLLIDED in self.rows


def open_source(text: str, parameter: str) -> Source:
    """Open ``FOLDER`` or, for one tracker of a grid, ``FOLDER@LABEL``.

    A folder of baselines stands for the standard suite's in it.

    Raises:
        InputError: There is no such folder or label.
    """
    whole = Path(text)
    path, at, label = (text, "", "") if whole.exists() else text.rpartition("@") if "@" in text else (text, "", "")
    folder = Path(path)
    if (folder / STANDARD / RUNS).is_file():
        folder = folder / STANDARD
    source = _open_grid(text, folder, parameter) if (folder / RUNS).is_file() else _open_run(text, folder, parameter)
    if not at:
        return source
    rows = source.rows[source.rows["label"] == label]
    if not len(rows):
        raise InputError(f"`{parameter}`: {folder} has no tracker {label!r}; choose one of {', '.join(source.labels)}")
    return replace(source, rows=rows)


def _open_grid(name: str, folder: Path, parameter: str) -> Source:
    table = runfolder.read_table(folder, RUNS, parameter, (*SETTING, "seed", "succeeded", "variant", "model"))
    done = labelled(table)
    try:
        vary = [str(word) for word in json.loads((folder / GRID).read_text(encoding="utf-8"))["vary"]]
    except (OSError, ValueError, KeyError, TypeError):
        raise InputError(f"`{parameter}`: {folder / GRID} is missing or broken; make the grid again") from None
    axes = (*(word.partition("=")[0].strip() for word in vary), *((MISMATCH,) if MISMATCH in table else ()))
    _check_rows(done, table, axes, folder / RUNS, parameter)
    return Source(name, folder, done, len(table) - len(done), False, axes)


def _check_rows(done: pd.DataFrame, table: pd.DataFrame, axes: tuple[str, ...], path: Path, parameter: str) -> None:
    """Refuse a table of runs that no grid writes: empty, with a run twice, with texts for numbers."""
    if not len(table):
        raise InputError(f"`{parameter}`: {path} has no rows; make the grid again")
    known = (*compared_quantities(), *compared_quantities(closed_loop=True))
    numbers = ("seed", *(quantity.key for quantity in known if quantity.key in table))
    texts = [name for name in numbers if not is_numeric_dtype(table[name]) and table[name].notna().any()]
    if texts:
        raise InputError(f"`{parameter}`: {path}: {texts[0]} holds no numbers; make the grid again")
    keys = ["label", *(name for name in dict.fromkeys((*SETTING, RECORDING, *axes, "seed")) if name in done)]
    if done[keys].astype(str).duplicated().any():
        raise InputError(f"`{parameter}`: {path} has several rows of one run; make the grid again")


def _open_run(name: str, folder: Path, parameter: str) -> Source:
    if not folder.is_dir():
        raise InputError(f"`{parameter}`: {folder} is no folder; give the folder of a run or of a stress test")
    runfolder.read_manifest(folder, parameter)
    try:
        metrics: dict[str, Any] = json.loads((folder / runfolder.METRICS).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        raise InputError(
            f"`{parameter}`: {folder / runfolder.METRICS} is missing or broken; make the run again"
        ) from None
    run = metrics.pop("run", None) if isinstance(metrics, dict) else None
    known = isinstance(run, dict) and {*SETTING, "seed", "tracker", "model"} <= run.keys()
    if not known or not isinstance(run["seed"], int):
        raise InputError(f"`{parameter}`: {folder / runfolder.METRICS} is broken; make the run again")
    row = {**run, "variant": run["tracker"], **flattened(metrics), "succeeded": True}
    return Source(name, folder, labelled(pd.DataFrame([row])).drop(columns="succeeded"), 0, True)
