"""A run of a grid as a run folder of its own, as ``run`` leaves one, without pictures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.common.files import write_text
from harness.common.numbers import as_json
from harness.config.model import RunConfig
from harness.grid.cells import Cell
from harness.grid.rerun import command_of
from harness.running.keeping import tables_of
from harness.running.recorder import RunTables
from harness.running.resolve import write_config
from harness.scoring import ScoredRun
from harness.storage import ownership
from harness.storage import run_folder as runfolder
from harness.storage.checks import rows_of
from harness.storage.grid_folder import KEPT
from harness.storage.grid_rows import Row
from harness.storage.manifest import RunFacts, write_manifest
from harness.storage.tables import write_table
from mmpf.map.road import Road

if TYPE_CHECKING:
    import pandas as pd

OnRow = Callable[[str, Row], None]


@dataclass(frozen=True)
class Outcome:
    """What a run gave.

    Attributes:
        tables: What was recorded.
        scored: Its errors and occlusion events.
        metrics: Its scores.
        steps: Number of steps.
        unseen: What was expected where there was no track; None where nobody watched.
    """

    tables: RunTables
    scored: ScoredRun
    metrics: Mapping[str, Any]
    steps: int
    unseen: pd.DataFrame | None = None


def keeping(execute: Callable[[list[Cell], OnRow], None], out: Path) -> Callable[[list[Cell], OnRow], None]:
    """Return what runs the cells of a grid's folder so that each run leaves a run folder there."""
    keep_in = (out / KEPT).resolve()
    return lambda cells, on_row: execute([replace(cell, keep_in=keep_in) for cell in cells], on_row)


def keep_run(folder: Path, config: RunConfig, road: Road, outcome: Outcome, command: str | None = None) -> None:
    """Write a finished run's folder; the manifest comes last, so that half a folder is none.

    Args:
        folder: The folder.
        config: The run's configuration.
        road: The lanes.
        outcome: What the run gave.
        command: What made it; None for the command that makes it again by itself.
    """
    (folder / runfolder.FIGURES).mkdir(parents=True, exist_ok=True)
    (folder / runfolder.MANIFEST).unlink(missing_ok=True)
    ownership.claim(folder, ownership.RUN)
    write_config(config, folder / runfolder.CONFIG)
    runfolder.write_road(road, folder / runfolder.ROAD)
    tables, scored = outcome.tables, outcome.scored
    for name, table in (
        (runfolder.TRUTH, tables.truth),
        (runfolder.DETECTIONS, tables.detections),
        (runfolder.TRACKS, tables.tracks),
        *(() if outcome.unseen is None else ((runfolder.UNSEEN, outcome.unseen),)),
        *tables_of(scored).items(),
    ):
        write_table(table, folder / name)
    write_text(folder / runfolder.METRICS, as_json(dict(outcome.metrics)))
    facts = RunFacts(
        runfolder.COMPLETE, command or command_of(config), config.seed, outcome.steps, rows=rows_of(folder)
    )
    write_manifest(folder / runfolder.MANIFEST, facts)
    ownership.record_all(folder, ownership.RUN)
