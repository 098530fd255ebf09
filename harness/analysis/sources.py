"""The two sides of a comparison: the rows of a run folder or a stress folder, or of one tracker in it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from harness.analysis.curves import labelled
from harness.analysis.experiments import settings_of, settings_of_grid
from harness.analysis.rules import compared_quantities
from harness.common.errors import InputError
from harness.common.untrusted_files import read_json, reading
from harness.scoring.metrics.closedloop import COLLIDED
from harness.scoring.metrics.registry import is_from_outside
from harness.storage import run_folder as runfolder
from harness.storage.grid_folder import GRID, RUNS, flattened
from harness.storage.manifest import check_unedited, manifest_of
from harness.storage.schema import MISMATCH, RECORDING, TABLES

STANDARD = "standard"
ROUNDING = 1e-6
SETTING = ("net", "density", "demand")


@dataclass(frozen=True)
class Source:
    """One side of a comparison.

    Attributes:
        name: What the user typed.
        rows: One row per successful run, with a column ``label``.
        failed: Number of runs that failed, and in ``failed_labels`` the tracker of each, with its settings and model.
        is_run: Whether it is a single run's folder.
        axes: Columns that were varied beside density, demand and seed, the mismatch among them.
        settings: Settings that hold for all its runs, by key.
        manifest: Content of its ``manifest.json``; empty without one.
    """

    name: str
    folder: Path
    rows: pd.DataFrame
    failed: int
    is_run: bool
    axes: tuple[str, ...] = ()
    failed_labels: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    manifest: Mapping[str, Any] = field(default_factory=dict)

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
    # A label may hold an @ too, as the name of a model's file does: the folder is what is there.
    cuts = [] if whole.exists() else [place for place, letter in enumerate(text) if letter == "@"]
    cut = next((place for place in cuts if Path(text[:place]).is_dir()), cuts[-1] if cuts else len(text))
    folder, at, label = Path(text[:cut]), text[cut : cut + 1], text[cut + 1 :]
    if (folder / STANDARD / RUNS).is_file():
        folder = folder / STANDARD
    source = _open_grid(text, folder, parameter) if (folder / RUNS).is_file() else _open_run(text, folder, parameter)
    if not at:
        return source
    rows = source.rows[source.rows["label"] == label]
    lost = source.failed_labels.count(label)
    if not len(rows) and lost:
        raise InputError(f"`{parameter}`: all {lost} runs of {label!r} in {folder} failed; its table.md says why")
    if not len(rows):
        known = ", ".join(source.labels) or "none, since all its runs failed"
        raise InputError(f"`{parameter}`: {folder} has no tracker {label!r}; choose one of {known}")
    return replace(source, rows=rows, failed=lost, failed_labels=(label,) * lost)


def _open_grid(name: str, folder: Path, parameter: str) -> Source:
    table = runfolder.read_table(folder, RUNS, parameter, (*SETTING, "seed", "succeeded", "variant", "model"))
    done = labelled(table)
    with reading(f"`{parameter}`: {folder / GRID}", "list of what a grid runs"):
        asked = read_json(folder / GRID)
        vary = [str(word) for word in asked["vary"]]
        settings = settings_of_grid(asked)
    manifest = manifest_of(folder)
    check_unedited(folder, manifest, parameter)
    axes = (*(word.partition("=")[0].strip() for word in vary), *((MISMATCH,) if MISMATCH in table else ()))
    _check_rows(done, table, axes, folder / RUNS, parameter)
    lost = table[~table["succeeded"].astype(bool)].assign(succeeded=True)
    labels = tuple(labelled(lost)["label"]) if len(lost) else ()
    return Source(name, folder, done, len(lost), False, axes, labels, settings, manifest)


def _check_rows(done: pd.DataFrame, table: pd.DataFrame, axes: tuple[str, ...], path: Path, parameter: str) -> None:
    """Refuse a table of runs that no grid writes: empty, with a run twice, with texts for numbers."""
    if not len(table):
        raise InputError(f"`{parameter}`: {path} has no rows; make the grid again")
    texts = {*axes, *(column.name for column in TABLES[RUNS].columns)}
    others = table[[name for name in table if "." in str(name) and name not in texts]].select_dtypes(exclude="number")
    if wordy := [name for name in others if others[name].notna().any()]:
        raise InputError(f"`{parameter}`: {path}: {wordy[0]} holds no numbers; make the grid again")
    for quantity in (*compared_quantities(), *compared_quantities(closed_loop=True)):
        if quantity.key not in table or is_from_outside(quantity):
            continue
        values = table[quantity.key].to_numpy(dtype=np.float64)
        possible = np.isfinite(values) & (values >= quantity.least) & (values <= quantity.most + ROUNDING)
        wrong = values[~possible & ~np.isnan(values)]
        if len(wrong):
            raise InputError(
                f"`{parameter}`: {path}: {quantity.key} holds {wrong[0]:g}, which is not a possible value of "
                f"{quantity.label}; make it again"
            )
    keys = ["label", *(name for name in dict.fromkeys((*SETTING, RECORDING, *axes, "seed")) if name in done)]
    if done[keys].astype(str).duplicated().any():
        raise InputError(f"`{parameter}`: {path} has several rows of one run; make the grid again")


def _open_run(name: str, folder: Path, parameter: str) -> Source:
    if not folder.is_dir():
        raise InputError(f"`{parameter}`: {folder} is not a folder; give the folder of a run or of a stress test")
    manifest = runfolder.read_manifest(folder, parameter)
    check_unedited(folder, manifest, parameter)
    metrics = runfolder.read_metrics(folder, parameter)
    run = metrics.pop("run", None)
    known = isinstance(run, dict) and {*SETTING, "seed", "tracker", "model"} <= run.keys()
    if not known or not isinstance(run["seed"], int):
        raise InputError(f"`{parameter}`: {folder / runfolder.METRICS} is broken; make the run again")
    row = {**run, "variant": run["tracker"], **flattened(metrics), "succeeded": True}
    table = pd.DataFrame([row])
    done = labelled(table)
    _check_rows(done, table, (), folder / runfolder.METRICS, parameter)
    settings = settings_of(runfolder.read_config_table(folder, parameter))
    return Source(name, folder, done.drop(columns="succeeded"), 0, True, (), (), settings, manifest)
