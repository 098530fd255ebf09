"""A stress test: makes its grid and writes its folder; an interrupted one can be resumed."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

from harness.analysis.curve_charts import curve_charts
from harness.analysis.curves import Break, Point, breaks, curve_points
from harness.analysis.mismatch_cost import costs, costs_markdown, leads
from harness.analysis.pooled import pool_files
from harness.analysis.pooled_tables import hidden_charts, pooled_markdown
from harness.analysis.tables import as_markdown
from harness.common.charts import draw_charts
from harness.common.errors import InputError
from harness.common.files import write_text
from harness.common.numbers import without_nan
from harness.grid.cells import GridPlan, assemble, distinct_trackers, labels_markdown
from harness.grid.grid import GridRequest, plan_grid, with_example
from harness.grid.making import SUMMARY, TABLE, Making, RunCells, Telling, make_rows
from harness.running.open import check_named_code, open_snapshots
from harness.sensor.profiles import sensor_settings
from harness.storage.grid_folder import FIGURES, RUNS, Row
from harness.storage.schema import MISMATCH, RECORDING
from harness.storage.tables import write_table
from harness.truth.network.network import load_network


@dataclass(frozen=True)
class FinishedGrid:
    """A grid that ended: its folder, the title and summary of its tables, the curves, and where trackers break."""

    folder: Path
    title: str
    summary: dict[str, Any]
    points: Sequence[Point]
    breaks: Sequence[Break]

    @property
    def failures(self) -> list[str]:
        """One line for each run that failed."""
        return _lines(self.summary["failures"])


def run_stress(
    request: GridRequest,
    out: Path,
    execute: RunCells,
    *,
    resume: bool = False,
    retry_failed: bool = False,
    user: Telling | None = None,
    command: str = "",
) -> FinishedGrid:
    """Run a grid and write its folder. ``harness.grid.making.make_rows`` has the other arguments and the errors.

    Args:
        execute: Runs the cells: in processes of this machine (``harness.grid.pool``) or on a cluster.
        command: What the user typed, for the manifest.
    """
    user = user or Telling()
    grid = plan_grid(request)
    check_grid(grid, user.tell)
    making, write_outcome = Making(grid, request.as_table(), command), partial(_write_outcome, grid, request, out)
    return make_rows(making, out, execute, write_outcome, resume=resume, retry_failed=retry_failed, user=user)


def check_grid(grid: GridPlan, tell: Callable[[str], object]) -> None:
    """Find a wrong network, recording, sensor or tracker before any run is made; report what recordings hold."""
    if grid.is_replay:
        _check_sensors_and_trackers(grid)
        # Every file is read once, so that a broken one is reported before hours of runs over the others.
        for config in {str(cell.config.replay): cell.config for cell in grid.cells}.values():
            tell(open_snapshots(config).report)
        return
    traffic = dict.fromkeys((each.net, each.demand, each.density) for each in (c.config.traffic for c in grid.cells))
    for name, points in groupby(traffic, key=itemgetter(0)):
        network = load_network(name)
        for _, demand, density in points:
            if network.configuration is not None and (density is not None or demand is not None):
                raise InputError(f"`densities`: {network.name} brings its own demand; leave densities and demands out")
            if demand is not None:
                network.demand(demand)
    _check_sensors_and_trackers(grid)


def _check_sensors_and_trackers(grid: GridPlan) -> None:
    for config in {json.dumps(cell.config.sensor.model_dump()): cell.config for cell in grid.cells}.values():
        try:
            sensor_settings(config.sensor.profile, config.sensor.overrides)
        except InputError as error:
            raise with_example(error, grid.axes) from None
    for config in distinct_trackers(grid):
        check_named_code(config)


def _write_outcome(grid: GridPlan, request: GridRequest, out: Path, rows: Mapping[str, Row]) -> FinishedGrid:
    """Write curves over the axes; of recorded traffic, one table over all files; of mismatches, what each costs."""
    table = assemble(grid, rows)
    failures = [
        {"key": run.key, "run": _in_words(rows[run.key]), "error": rows[run.key]["error"]}
        for run in grid.runs
        if not rows[run.key]["succeeded"]
    ]
    (out / FIGURES).mkdir(exist_ok=True)
    points: Sequence[Point] = ()
    broken: Sequence[Break] = ()
    if request.mismatch:
        found, ahead = costs(table), leads(table)
        numbers: dict[str, Any] = {"mismatches": list(map(asdict, found)), "leads": list(map(asdict, ahead))}
        text = costs_markdown(found, _lines(failures), ahead)
    elif grid.is_replay:
        pooled = pool_files(table)
        draw_charts(hidden_charts(pooled), "Hidden vehicles in recorded traffic", out / FIGURES / "hidden.png")
        numbers, text = asdict(pooled), pooled_markdown(pooled, _lines(failures))
    else:
        points, broken = curve_points(table, grid.axes), breaks(table)
        for axis in dict.fromkeys(point.axis for point in points):
            picture = out / FIGURES / f"over_{axis.replace('.', '_')}.png"
            draw_charts(curve_charts(points, axis), request.title, picture)
        numbers = {"breaks": list(map(asdict, broken)), "curves": list(map(asdict, points))}
        text = as_markdown(request.title, points, broken, _lines(failures))
    about = {"grid": request.as_table(), "runs": len(grid.runs), "failed": len(failures), "failures": failures}
    summary: dict[str, Any] = without_nan(about | numbers)
    write_text(out / TABLE, text + labels_markdown(grid))
    write_text(out / SUMMARY, json.dumps(summary, indent=2) + "\n")
    write_table(table, out / RUNS)
    return FinishedGrid(out, request.title, summary, points, broken)


def _lines(failures: Sequence[Mapping[str, str]]) -> list[str]:
    return [failure["run"] + ": " + failure["error"] for failure in failures]


def _in_words(row: Mapping[str, Any]) -> str:
    """Return the label of a row's run."""
    names = ("net", "density", "demand", RECORDING, MISMATCH, "variant", "model", "seed")
    words = [f"{name} {row[name]}" for name in names if row.get(name) is not None]
    return ", ".join(
        [*words, *(f"{key}={row[key]:g}" for key in row if key.startswith(("sensor.", "tracker.", "traffic.")))]
    )
