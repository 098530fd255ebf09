"""A stress test from grid to finished folder, which an interrupted one takes up again."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from harness.errors import InputError, RunError, RunInterruptedError
from harness.grid.cells import MISMATCH, RECORDING, Cell, Grid, distinct_trackers
from harness.grid.expected import expected_s, work_s
from harness.grid.grid import GridRequest, plan_grid, with_example
from harness.grid.gridfolder import GRID, RUNS, check_same_grid, open_grid_folder
from harness.grid.pool import OnRow
from harness.grid.rows import Row, assemble, read_rows, write_row
from harness.grid.summary import Break, Point, breaks, curve_points
from harness.runfolder import folder as runfolder
from harness.runfolder.manifest import RunFacts, write_manifest
from harness.writing.files import save_figure, write_text
from harness.writing.numbers import without_nan
from harness.writing.progress import progress_bar
from harness.writing.rough import say_roughly

if TYPE_CHECKING:
    import pandas as pd


SUMMARY, TABLE, FIGURES = "summary.json", "table.md", "figures"

RunCells = Callable[[list[Cell], OnRow], None]


@dataclass(frozen=True)
class FinishedGrid:
    """A grid that ended.

    Attributes:
        folder: Where its files lie.
        title: What its tables are headed by.
        summary: Content of its ``summary.json``.
        points: The curves.
        breaks: Where each tracker breaks.
    """

    folder: Path
    title: str
    summary: dict[str, Any]
    points: Sequence[Point]
    breaks: Sequence[Break]

    @property
    def failures(self) -> list[str]:
        """One line for each run that failed."""
        return _lines(self.summary["failures"])


@dataclass(frozen=True)
class Telling:
    """How the user is told of what goes on.

    Attributes:
        quiet: Whether to leave out the progress bar.
        warn: Called with a line that should be read.
        tell: Called with what was read of each file of recorded traffic, and how long all will roughly take.
        workers: How many runs are made at a time, for the guess of how long all take; None if that is unknown.
    """

    quiet: bool = True
    warn: Callable[[str], object] = str
    tell: Callable[[str], object] = str
    workers: int | None = None


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
    """Run a grid and write its folder.

    Args:
        request: The grid.
        out: The folder.
        execute: Runs the cells: in processes of this machine (``harness.grid.pool``) or on a cluster.
        resume: Whether runs that the folder already holds are kept.
        retry_failed: Whether those of them that failed are made again.
        user: How the user is told of what goes on; None for not at all.
        command: What the user typed, for the manifest.

    Raises:
        InputError: The grid or the folder is wrong; no run was made.
        RunInterruptedError: The user stopped it; finished runs are kept.
        RunError: The disk is full, the cluster is lost or the like; finished runs are kept.
    """
    user = user or Telling()
    grid = plan_grid(request)
    _check_grid(grid, user.tell)
    done: dict[str, Row] = {}
    with open_grid_folder(out, resume) as rows_folder, _ends_in_one_line(out, done, len(grid.runs)):
        check_same_grid(out, rows_folder, {run.key for run in grid.runs})
        there = read_rows(rows_folder, (run.key for run in grid.runs))
        done |= {key: row for key, row in there.items() if row["succeeded"] or not retry_failed}
        versions = _versions(out)
        _write_manifest(out, command, grid, runfolder.INTERRUPTED, len(done))
        if done and versions != _versions(out):
            user.warn(
                f"the {len(done)} runs that {out} holds were made by another version of the software; is that meant?"
            )
        write_text(out / GRID, json.dumps(request.as_table(), indent=2) + "\n")
        cells = _rest_of(grid, done)
        # What was made of fewer runs goes.
        for name in (RUNS, SUMMARY, TABLE) if cells else ():
            (out / name).unlink(missing_ok=True)
        title = "stress" if not done else f"stress ({len(done)} of {len(grid.runs)} done before)"
        left = len(grid.runs) - len(done)
        if user.workers is not None:
            say_roughly(user.tell, expected_s(cells, user.workers), f"{left} runs, {user.workers} at a time")
        with progress_bar(title, left, user.quiet, before=f"{title}: loading, warming up traffic") as advance:

            def keep(key: str, row: Row) -> None:
                write_row(rows_folder, key, without_nan(row))
                done[key] = row
                advance()

            execute(cells, keep)
        finished = _write_outcome(grid, request, out, read_rows(rows_folder, (run.key for run in grid.runs)))
        _write_manifest(out, command, grid, runfolder.COMPLETE, len(grid.runs))
        return finished


def _rest_of(grid: Grid, done: Mapping[str, Row]) -> list[Cell]:
    """Return what is left to run, the longest first, so that no worker is left alone with it in the end."""
    left = (Cell(tuple(run for run in cell.runs if run.key not in done)) for cell in grid.cells)
    return sorted((cell for cell in left if cell.runs), key=lambda cell: -work_s(cell))


@contextmanager
def _ends_in_one_line(out: Path, done: Mapping[str, Row], runs: int) -> Iterator[None]:
    """Turn an interrupt, and what the system refuses, a full disk for example, into an error that says what is kept."""
    mend = "go on with the same command and `resume`"
    try:
        yield
    except KeyboardInterrupt:
        raise RunInterruptedError(f"interrupted after {len(done)} of {runs} runs; {mend}") from None
    except (OSError, MemoryError) as error:
        problem = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        if isinstance(error, OSError) and error.strerror:
            problem = f"{error.filename}: {error.strerror}" if error.filename else error.strerror
        raise RunError(
            f"the stress test in {out} can't go on ({problem}); {len(done)} of {runs} runs are kept; "
            f"once that is mended, {mend}"
        ) from error


def _check_grid(grid: Grid, tell: Callable[[str], object]) -> None:
    """Find a wrong network, recording, sensor or tracker before any run is made; tell what was read of recordings."""
    from harness.truth.network.network import load_network  # noqa: PLC0415

    if grid.is_replay:
        _check_sensors_and_trackers(grid)
        _check_recordings(grid, tell)
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


def _check_recordings(grid: Grid, tell: Callable[[str], object]) -> None:
    """Read every file once, so that a broken one is told before hours of runs over the others."""
    from harness.running.open import open_looks  # noqa: PLC0415

    for config in {str(cell.config.replay): cell.config for cell in grid.cells}.values():
        tell(open_looks(config).report)


def _check_sensors_and_trackers(grid: Grid) -> None:
    from harness.running.open import check_driver, check_tracker  # noqa: PLC0415
    from harness.sensor.profiles import sensor_settings  # noqa: PLC0415

    for config in {json.dumps(cell.config.sensor.model_dump()): cell.config for cell in grid.cells}.values():
        try:
            sensor_settings(config.sensor.profile, config.sensor.overrides)
        except InputError as error:
            raise with_example(error, grid.axes) from None
    for config in distinct_trackers(grid):
        check_tracker(config)
        check_driver(config)


def _write_manifest(out: Path, command: str, grid: Grid, status: str, runs: int) -> None:
    write_manifest(out / runfolder.MANIFEST, RunFacts(status, command, grid.cells[0].config.seed, runs))


def _versions(out: Path) -> Any:  # noqa: ANN401
    """Return what made the folder's runs, as far as its manifest tells."""
    try:
        manifest = json.loads((out / runfolder.MANIFEST).read_text(encoding="utf-8"))
        return manifest["git_revision"], manifest["versions"]
    except (OSError, ValueError, KeyError):
        return None


def _write_outcome(grid: Grid, request: GridRequest, out: Path, rows: Mapping[str, Row]) -> FinishedGrid:
    """Write curves over the axes; of recorded traffic, one table over all files."""
    from harness.runfolder.tables import write_table  # noqa: PLC0415

    table = assemble(grid, rows)
    failures = [
        {"key": run.key, "run": _in_words(rows[run.key]), "error": rows[run.key]["error"]}
        for run in grid.runs
        if not rows[run.key]["succeeded"]
    ]
    (out / FIGURES).mkdir(exist_ok=True)
    tell = _mismatched if request.mismatch else _pooled if grid.is_replay else _curves
    told = tell(table, grid, request, out / FIGURES, _lines(failures))
    about = {"grid": request.as_table(), "runs": len(grid.runs), "failed": len(failures), "failures": failures}
    summary: dict[str, Any] = without_nan(about | told.numbers)
    write_text(out / TABLE, told.text)
    write_text(out / SUMMARY, json.dumps(summary, indent=2) + "\n")
    write_table(table, out / RUNS)
    return FinishedGrid(out, request.title, summary, told.points, told.breaks)


@dataclass(frozen=True)
class _Told:
    """What a grid tells: numbers for programs, the same as Markdown, and curves with the places where they end."""

    numbers: dict[str, Any]
    text: str
    points: Sequence[Point] = ()
    breaks: Sequence[Break] = ()


def _curves(table: pd.DataFrame, grid: Grid, request: GridRequest, figures: Path, failures: list[str]) -> _Told:
    from harness.grid.tables import as_markdown, curves_figure  # noqa: PLC0415

    points, broken = curve_points(table, grid.axes), breaks(table)
    for axis in dict.fromkeys(point.axis for point in points):
        save_figure(curves_figure(points, axis, request.title), figures / f"over_{axis.replace('.', '_')}.png")
    numbers = {"breaks": [asdict(entry) for entry in broken], "curves": [asdict(point) for point in points]}
    return _Told(numbers, as_markdown(request.title, points, broken, failures), points, broken)


def _mismatched(table: pd.DataFrame, grid: Grid, request: GridRequest, figures: Path, failures: list[str]) -> _Told:  # noqa: ARG001
    from harness.grid.mismatch import costs, costs_markdown  # noqa: PLC0415

    found = costs(table)
    return _Told({"mismatches": [asdict(cost) for cost in found]}, costs_markdown(found, failures))


def _pooled(table: pd.DataFrame, grid: Grid, request: GridRequest, figures: Path, failures: list[str]) -> _Told:  # noqa: ARG001
    from harness.grid.pooled import pool_files  # noqa: PLC0415
    from harness.grid.pooled_tables import hidden_figure, pooled_markdown  # noqa: PLC0415

    pooled = pool_files(table)
    save_figure(hidden_figure(pooled), figures / "hidden.png")
    return _Told(asdict(pooled), pooled_markdown(pooled, failures))


def _lines(failures: Sequence[Mapping[str, str]]) -> list[str]:
    return [failure["run"] + ": " + failure["error"] for failure in failures]


def _in_words(row: Mapping[str, Any]) -> str:
    """Return in words which run a row is of."""
    names = ("net", "density", "demand", RECORDING, MISMATCH, "variant", "model", "seed")
    words = [f"{name} {row[name]}" for name in names if row.get(name) is not None]
    return ", ".join(
        [*words, *(f"{key}={row[key]:g}" for key in row if key.startswith(("sensor.", "tracker.", "traffic.")))]
    )
