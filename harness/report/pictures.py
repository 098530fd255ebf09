"""Figures of a run, and those of any folder redrawn for papers as PNG, SVG or PDF, with the same bytes each time."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure

from harness.analysis.curve_charts import curve_charts
from harness.analysis.curves import curve_points
from harness.common.charts import KINDS, Charts, draw_charts
from harness.common.errors import InputError
from harness.common.files import check_unlinked, save_figure
from harness.grid.grid import title_of
from harness.report.failures import failures_of
from harness.report.grid_runs import plan_of
from harness.report.run_charts import (
    BY_VISIBILITY,
    DIAGNOSTICS,
    OVER_TIME,
    diagnostics_charts,
    diagnostics_of,
    error_charts,
    visibility_charts,
)
from harness.report.scene import PictureScene, scene_figure
from harness.running.finished import RecordedRun, read_recorded_run
from harness.running.recorder import tracks_of
from harness.running.replay import snapshots_of
from harness.running.run import Pictured
from harness.storage import ownership
from harness.storage import run_folder as runfolder
from harness.storage.checks import sound_tables
from harness.storage.grid_folder import RUNS

# What would change from one drawing to the next: the date, and numbers that tell a file's parts apart.
UNDATED = {"png": {}, "svg": {"Date": None}, "pdf": {"CreationDate": None, "ModDate": None}}
SALT = "mmpf-harness"


def write_pictures(folder: Path, kind: str) -> list[Path]:
    """Draw the figures of a run or of a stress test's curves into ``figures/`` of its folder, and return them.

    Raises:
        InputError: The kind is none of ``png``, ``svg`` and ``pdf``, or nothing in the folder is drawn anew.
    """
    if kind not in KINDS:
        raise InputError(f"`figures` {kind}: no such kind of picture; choose one of {', '.join(KINDS)}")
    is_run = (folder / runfolder.TRUTH).is_file()
    if not is_run and (plan_of(folder) is None or not (folder / RUNS).is_file()):
        raise InputError(f"`figures`: {folder} is neither a run nor a stress test; only their figures can be drawn")
    place = folder / runfolder.FIGURES
    check_unlinked(folder, (place, *place.glob(f"*.{kind}")), "folder")
    place.mkdir(exist_ok=True)
    with sound_tables(folder, "figures"), mpl.rc_context({"svg.hashsalt": SALT, "svg.fonttype": "none"}):
        written = [*(_of_run(folder, place, kind) if is_run else _of_grid(folder, place, kind))]
    ownership.add(folder, written)
    return written


def _of_run(folder: Path, place: Path, kind: str) -> Iterator[Path]:
    run = read_recorded_run(folder)
    for name, group in _charts(run.errors, run.metrics["mae"], diagnostics_of(run)).items():
        path = (place / name).with_suffix(f".{kind}")
        draw_charts(group, run.config.title(), path)
        yield path
    for number, figure in enumerate(_failure_figures(run), start=1):
        path = place / f"failure-{number}.{kind}"
        save_figure(figure, path, metadata=UNDATED[kind])
        yield path


def _charts(errors: pd.DataFrame, mae: Mapping[str, Any], diagnostics: pd.DataFrame | None) -> dict[str, Charts]:
    """Return a run's charts by the file of their picture."""
    charts = {OVER_TIME: error_charts(errors), BY_VISIBILITY: visibility_charts(mae)}
    return charts if diagnostics is None else charts | {DIAGNOSTICS: diagnostics_charts(diagnostics)}


def _failure_figures(run: RecordedRun) -> Iterator[Figure]:
    """Yield the road from above at the moment at which each of the worst failures ends, with its vehicle named."""
    times = run.truth.drop_duplicates("step").set_index("step")["time_s"]
    for failure in failures_of(run).worst:
        step = (times - failure.end_s).abs().idxmin()
        truth, detections, tracks = (table[table["step"] == step] for table in (run.truth, run.detections, run.tracks))
        (snapshot,) = snapshots_of(truth, detections, run.road, run.sensor)
        seen = snapshot.frame, snapshot.observation
        scene = PictureScene(*seen, tracks_of(tracks), run.road, run.sensor.range_m, named=failure.vehicle_id)
        yield scene_figure(scene, f"{snapshot.frame.time_s:.1f} s. {failure.sentence}")


def _of_grid(folder: Path, place: Path, kind: str) -> Iterator[Path]:
    if (grid := plan_of(folder)) is None or grid.is_replay:
        return
    table = runfolder.read_table(folder, RUNS, "folder", ("seed", "succeeded"))
    points = curve_points(table, grid.axes)
    title = title_of(str(cell.config.traffic.net) for cell in grid.cells)
    for axis in dict.fromkeys(point.axis for point in points):
        path = place / f"over_{axis.replace('.', '_')}.{kind}"
        draw_charts(curve_charts(points, axis), title, path)
        yield path


def draw_figures(folder: Path, pictured: Pictured) -> None:
    """Draw all figures of a run into a new folder."""
    folder.mkdir()
    title, moment = pictured.title, pictured.moment
    if moment is not None:
        snapshot = moment.snapshot
        frame, seen, range_m = snapshot.frame, snapshot.observation, pictured.sensor.range_m
        scene = PictureScene(frame, seen, moment.tracks, pictured.road, range_m, moment.particles)
        scene_figure(scene, f"{title}: {frame.time_s:.1f} s").savefig(folder / "scene.png")
    for name, group in _charts(pictured.errors, pictured.metrics["mae"], pictured.diagnostics).items():
        draw_charts(group, title, folder / name)
