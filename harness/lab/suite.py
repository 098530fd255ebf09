"""The standard suite: a small grid with a committed baseline to check changes against."""

from __future__ import annotations

import shutil
from pathlib import Path

from harness.analysis.sources import STANDARD
from harness.common.errors import InputError
from harness.common.files import replacing
from harness.grid.grid import GridRequest
from harness.grid.making import TABLE, on_stderr
from harness.grid.pool import run_cells
from harness.grid.stress import FinishedGrid, run_stress
from harness.storage import run_folder as runfolder
from harness.storage.grid_folder import GRID, RUNS

SUITES = {
    STANDARD: GridRequest(
        net="us101", densities="20,40", trackers="mmpf", models="cvm,gmm", seeds="10", duration_s=30.0, particles=200
    ),
}
BASELINE = Path("results/reference")
KEPT = (RUNS, GRID, TABLE, runfolder.MANIFEST)


def keep_as_baseline(finished: FinishedGrid, name: str, baseline: Path) -> Path:
    """Copy what later comparisons need into the folder of baselines, over an earlier one, and return where it lies."""
    folder = baseline / name
    folder.mkdir(parents=True, exist_ok=True)
    for file in KEPT:
        with replacing(folder / file) as temporary:
            shutil.copyfile(finished.folder / file, temporary)
    return folder


def run_suite(name: str, out: Path, *, workers: int, resume: bool, quiet: bool) -> FinishedGrid:
    """Run a suite.

    Args:
        name: Its name.
        out: Folder to write.
        workers: Number of worker processes.
        resume: Whether runs that the folder already holds are kept.
        quiet: Whether to leave out the progress bar.

    Raises:
        InputError: There is no such suite, or the folder is wrong.
    """
    if name not in SUITES:
        raise InputError(f"`suite` {name}: no such suite; choose one of {', '.join(SUITES)}")
    return run_stress(
        SUITES[name],
        out,
        lambda cells, on_row: run_cells(cells, workers, None, on_row),
        resume=resume,
        user=on_stderr(quiet),
        command=f"harness compare --suite {name}",
    )
