"""Pictures for papers: a finished folder's figures drawn anew as PNG, SVG or PDF, the same bytes each time."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl
from matplotlib.figure import Figure

from harness.analysis.curves import curve_points
from harness.analysis.tables import curves_figure
from harness.common.errors import InputError
from harness.common.files import save_figure
from harness.grid.grid import title_of
from harness.report.figures import (
    BY_VISIBILITY,
    DIAGNOSTICS,
    OVER_TIME,
    diagnostics_figure,
    error_by_visibility,
    error_over_time,
)
from harness.report.gallery import strip_figure, worst_failures
from harness.report.gridruns import plan_of
from harness.running.finished import RecordedRun, read_recorded_run
from harness.storage import ownership
from harness.storage import run_folder as runfolder
from harness.storage.checks import sound_tables
from harness.storage.grid_folder import RUNS

PNG, SVG, PDF = KINDS = ("png", "svg", "pdf")
# What would change from one drawing to the next: the date, and numbers that tell a file's parts apart.
UNDATED = {PNG: {}, SVG: {"Date": None}, PDF: {"CreationDate": None, "ModDate": None}}
SALT = "mmpf-harness"


def write_pictures(folder: Path, kind: str, parameter: str = "figures") -> list[Path]:
    """Draw the figures of a run or of a stress test's curves into ``figures/`` of its folder, and return them.

    Args:
        folder: The folder.
        kind: ``png``, ``svg`` or ``pdf``.
        parameter: Parameter that named the kind, for the message.

    Raises:
        InputError: Another kind, or nothing in the folder is drawn anew.
    """
    if kind not in KINDS:
        raise InputError(f"`{parameter}` {kind}: no such kind of picture; choose one of {', '.join(KINDS)}")
    is_run = (folder / runfolder.TRUTH).is_file()
    if not is_run and (plan_of(folder) is None or not (folder / RUNS).is_file()):
        raise InputError(f"`{parameter}`: {folder} is no run and no stress test; only their figures are drawn anew")
    place, written = folder / runfolder.FIGURES, []
    place.mkdir(exist_ok=True)
    with sound_tables(folder, parameter), mpl.rc_context({"svg.hashsalt": SALT, "svg.fonttype": "none"}):
        for name, figure in _of_run(read_recorded_run(folder)) if is_run else _of_grid(folder):
            path = (place / name).with_suffix(f".{kind}")
            save_figure(figure, path, metadata=UNDATED[kind])
            written.append(path)
    ownership.add(folder, written)
    return written


def _of_run(run: RecordedRun) -> Iterator[tuple[str, Figure]]:
    title = run.config.title()
    yield OVER_TIME, error_over_time(run.errors, title)
    yield BY_VISIBILITY, error_by_visibility(run.metrics["mae"], title)
    if (run.folder / runfolder.DIAGNOSTICS).is_file():
        columns = ("time_s", "episode", "components", "effective_share", "association_entropy")
        table = runfolder.read_table(run.folder, runfolder.DIAGNOSTICS, "folder", columns)
        yield DIAGNOSTICS, diagnostics_figure(table, title)
    for number, failure in enumerate(worst_failures(run), start=1):
        yield f"gallery-{number}.png", strip_figure(run, failure)


def _of_grid(folder: Path) -> Iterator[tuple[str, Figure]]:
    grid = plan_of(folder)
    if grid is None or grid.is_replay:
        return
    table = runfolder.read_table(folder, RUNS, "folder", ("seed", "succeeded"))
    points = curve_points(table, grid.axes)
    for axis in dict.fromkeys(point.axis for point in points):
        title = title_of(str(cell.config.traffic.net) for cell in grid.cells)
        yield f"over_{axis.replace('.', '_')}.png", curves_figure(points, axis, title)
