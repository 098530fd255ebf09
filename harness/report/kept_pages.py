"""The pages of a grid's stored runs: each run, and each tracker beside the first tracker of its cell."""

from __future__ import annotations

from pathlib import Path

from harness.analysis.compare import compare
from harness.analysis.sources import open_source
from harness.common.files import write_text
from harness.common.progress import progress_bar
from harness.grid.cells import Cell, PlannedRun
from harness.report.comparison_page import comparison_page
from harness.report.grid_runs import BESIDE, plan_of
from harness.report.page import PAGE, write_run_page
from harness.storage import ownership
from harness.storage import run_folder as runfolder
from harness.storage.grid_folder import KEPT


def write_kept_pages(folder: Path, quiet: bool) -> None:
    """Write the pages of a grid's kept runs, and of each tracker beside the first of its cell."""
    grid = plan_of(folder)
    runs = grid.runs if grid is not None else ()
    kept = {run.key for run in runs if (folder / KEPT / run.key / runfolder.MANIFEST).is_file()}
    with progress_bar("pages of the runs", len(kept), quiet) as advance:
        for cell in grid.cells if grid is not None else ():
            for run in (run for run in cell.runs if run.key in kept):
                if not (folder / KEPT / run.key / PAGE).is_file():
                    write_run_page(folder / KEPT / run.key)
                    _write_beside(folder, cell, run, kept)
                advance()


def _write_beside(folder: Path, cell: Cell, run: PlannedRun, kept: set[str]) -> None:
    first = cell.runs[0]
    if run.key == first.key or first.key not in kept:
        return
    a, b = (open_source(str(folder / KEPT / each.key), "folder") for each in (first, run))
    page = b.folder / BESIDE
    write_text(page, comparison_page(compare(a, b)))
    ownership.add(b.folder, [page])
