"""Makes all episodes of a closed loop and writes their folder; an interrupted one can be resumed."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from harness.closedloop.plan import CROSS, TRACKED_S, DriveRequest, PlannedDrive, plan_drives
from harness.closedloop.summary import as_markdown, as_values, drive_charts, scores
from harness.common.charts import draw_charts
from harness.common.errors import InputError
from harness.common.files import write_text
from harness.common.numbers import without_nan
from harness.grid.cells import Cell, GridPlan, assemble, labels_markdown
from harness.grid.making import SUMMARY, TABLE, Making, Telling, keeping, make_rows
from harness.grid.pool import OnRow, run_cells
from harness.grid.stress import check_grid
from harness.scoring.metrics.closedloop import COLLIDED, IMPACT, WITH
from harness.storage import ownership
from harness.storage.grid_folder import FIGURES, KEPT, RUNS, Row, column_of
from harness.storage.tables import write_table
from harness.truth.network.network import load_network

if TYPE_CHECKING:
    import pandas as pd

FIGURE = "collisions_and_hard_brakes.png"
WORKER = "harness.closedloop.worker"
PAGES_OF_EACH = 3
"""Of each belief so many collisions, the hardest, get a page with a replay; the others keep their folders."""
BEFORE_S = 3.0
REPLAY = "replay"


@dataclass(frozen=True)
class FinishedDrives:
    """A closed loop that ended: its folder, tables in Markdown, ``summary.json``, keys of collisions with a page."""

    folder: Path
    text: str
    summary: dict[str, Any]
    shown: tuple[str, ...]

    @property
    def failures(self) -> list[str]:
        """One line for each drive that failed."""
        return [f"{failure['key']}: {failure['error']}" for failure in self.summary["failures"]]


@dataclass(frozen=True)
class Execution:
    """How drives are made.

    Attributes:
        workers: Number of processes.
        timeout_s: Longest time for a seed's traffic, and for a drive; None for no limit.
        resume: Whether drives that the folder already holds are kept.
        retry_failed: Whether those of them that failed are made again.
    """

    workers: int
    timeout_s: float | None = None
    resume: bool = False
    retry_failed: bool = False


def run_drives(
    request: DriveRequest,
    out: Path,
    how: Execution,
    user: Telling | None = None,
    command: str = "",
) -> FinishedDrives:
    """Drive every episode by every belief and write the folder.

    Args:
        request: Episodes and beliefs.
        out: The folder.
        how: How they are made.
        user: How the user is told of what goes on; None for not at all.
        command: What the user typed, for the manifest.

    Raises:
        InputError: The request or the folder is wrong; nothing was driven.
        RunInterruptedError: The user stopped it; finished drives are kept.
        RunError: The disk is full or the like; finished drives are kept.
    """
    user = user or Telling()
    grid = plan_drives(request)
    _check(grid, user)
    _check_road(request, grid)

    def execute(cells: list[Cell], on_row: OnRow) -> None:
        run_cells(cells, how.workers, how.timeout_s, on_row, WORKER)

    return make_rows(
        Making(grid, request.as_table(), command, ownership.DRIVE),
        out,
        keeping(execute, out),
        partial(_write_outcome, grid, request, out),
        resume=how.resume or how.retry_failed,
        retry_failed=how.retry_failed,
        user=user,
    )


def _check(grid: GridPlan, user: Telling) -> None:
    """Find a wrong network, sensor, tracker or driver before anything is driven, or raise ``InputError``."""
    try:
        check_grid(grid, user.tell)
    except InputError as error:
        raise InputError(str(error).replace("`tracker`", "`perception`")) from error.__cause__


def _check_road(request: DriveRequest, grid: GridPlan) -> None:
    """Refuse a road on which nothing can be made to flow at a speed, to stand in the way, or to cross."""
    crosses = any(isinstance(run, PlannedDrive) and run.kind == CROSS for run in grid.runs)
    if crosses and load_network(request.net).corridor is not None:
        raise InputError(f"`provoke` cross: {request.net} has no crossings; name another `net`, such as priority")
    if any(isinstance(run, PlannedDrive) and run.flow_mps is not None for run in grid.runs):
        _ = load_network(request.net).main_road


def _write_outcome(grid: GridPlan, request: DriveRequest, out: Path, rows: Mapping[str, Row]) -> FinishedDrives:
    table = assemble(grid, rows)
    failures = [
        {"key": run.key, "error": rows[run.key]["error"]} for run in grid.runs if not rows[run.key]["succeeded"]
    ]
    found = scores(table)
    shown = _hardest(grid, table)
    links = [
        _link(run.key, row) if run.key in shown else ""
        for run, (_, row) in zip(grid.runs, table.iterrows(), strict=True)
    ]
    title = f"The ego drives by what it perceives, on {request.net}"
    text = as_markdown(
        title, found, table.assign(**{REPLAY: links}), [f"{each['key']}: {each['error']}" for each in failures]
    )
    (out / FIGURES).mkdir(exist_ok=True)
    draw_charts(drive_charts(found), title, out / FIGURES / FIGURE)
    about = {"drive": request.as_table(), "runs": len(grid.runs), "failed": len(failures), "failures": failures}
    summary: dict[str, Any] = without_nan(about | {"scores": as_values(found)})
    write_text(out / TABLE, text + labels_markdown(grid))
    write_text(out / SUMMARY, json.dumps(summary, indent=2) + "\n")
    write_table(table, out / RUNS)
    return FinishedDrives(out, text, summary, tuple(shown))


def _hardest(grid: GridPlan, table: pd.DataFrame) -> list[str]:
    """Return the keys of the collisions that get a page."""
    collided = column_of(table, COLLIDED) > 0.0
    keyed = table.assign(key=[run.key for run in grid.runs])[collided]
    if not len(keyed):
        return []
    hard = keyed.sort_values(IMPACT, ascending=False, kind="stable").groupby("variant", sort=False)
    return [str(key) for key in hard.head(PAGES_OF_EACH)["key"]]


def _link(key: str, row: Any) -> str:  # noqa: ANN401  a row of pandas
    """Return the address of a collision's replay, some seconds before it."""
    begin_s = max(0.0, TRACKED_S + float(row["drive.collision_time_s"]) - BEFORE_S)
    return f"{KEPT}/{key}/report.html#t={begin_s:.1f}&vehicle={quote(str(row[WITH]), safe='')}"
