"""Makes the rows of a grid in its folder; an interrupted grid can be resumed."""

import json
from collections import ChainMap
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

from harness.common.error_text import in_words
from harness.common.errors import RunError, RunInterruptedError
from harness.common.files import write_text
from harness.common.numbers import without_nan
from harness.common.progress import progress_bar
from harness.common.streams import to_stderr
from harness.config.model import RunConfig
from harness.grid.cells import FULL_DISK, Cell, GridPlan, distinct_trackers
from harness.grid.pool import OnRow
from harness.running.open import input_files
from harness.running.provenance import model_files, other_code, own_code, provenance_of
from harness.storage import ownership
from harness.storage import run_folder as runfolder
from harness.storage.grid_folder import (
    GRID,
    KEPT,
    ROWS,
    RUNS,
    Row,
    check_same_grid,
    open_grid_folder,
    read_rows,
    write_row,
)
from harness.storage.manifest import CODE, INPUTS, RunFacts, hashes_of, manifest_of, sha256_of, write_manifest

SUMMARY, TABLE = "summary.json", "table.md"

RunCells = Callable[[list[Cell], OnRow], None]
Outcome = TypeVar("Outcome")


@dataclass(frozen=True)
class Telling:
    """How the user is told: ``warn`` takes what should be read, ``tell`` what a file of recorded traffic holds."""

    quiet: bool = True
    warn: Callable[[str], object] = str
    tell: Callable[[str], object] = str


def keeping(execute: RunCells, out: Path, warn: Callable[[str], object] = str) -> RunCells:
    """Return what runs the cells of a grid's folder so that each run leaves a run folder there.

    ``warn`` is told of runs that are not made again and have none.
    """
    keep_in = (out / KEPT).resolve()

    def run_and_keep(cells: list[Cell], on_row: OnRow) -> None:
        done = {path.stem for path in (out / ROWS).glob("*.json")} - {run.key for cell in cells for run in cell.runs}
        if lacking := sum(not (keep_in / key).is_dir() for key in done):
            warn(
                f"finished runs in {out} without a folder: {lacking}; they failed, or were made without `keep`; make "
                "the grid in another folder to have all"
            )
        execute([replace(cell, keep_in=keep_in) for cell in cells], on_row)

    return run_and_keep


def on_stderr(quiet: bool) -> Telling:
    """Return output to stderr: warnings always, the rest unless quiet."""
    return Telling(
        quiet,
        warn=lambda line: to_stderr(f"warning: {line}"),
        tell=lambda text: None if quiet else to_stderr(text),
    )


@dataclass(frozen=True)
class Making:
    """What is made.

    Attributes:
        kind: What kind of folder it makes (``harness.storage.ownership``), which heads the progress bar too.
    """

    grid: GridPlan
    table: Mapping[str, Any]
    command: str = ""
    kind: str = ownership.STRESS


def make_rows(
    making: Making,
    out: Path,
    execute: RunCells,
    write_outcome: Callable[[Mapping[str, Row]], Outcome],
    *,
    resume: bool,
    retry_failed: bool,
    user: Telling,
) -> Outcome:
    """Make the rows of a grid that its folder lacks, then write their results.

    Args:
        write_outcome: Writes what all rows tell into the folder, and returns it.
        resume: Whether rows that the folder already holds are kept.
        retry_failed: Whether those of them that failed are made again.

    Raises:
        InputError: The folder is wrong; no run was made.
        RunInterruptedError: The user stopped it; finished runs are kept.
        RunError: The disk is full, the cluster is lost or the like; finished runs are kept.
    """
    grid, command, done = making.grid, making.command, dict[str, Row]()
    stopped = _ends_in_one_line(f"the {ownership.plain(making.kind)} in {out}", done, len(grid.runs))
    with open_grid_folder(out, resume, making.kind) as rows_folder, stopped:
        check_same_grid(out, rows_folder, {run.key for run in grid.runs})
        there = read_rows(rows_folder, (run.key for run in grid.runs))
        before = manifest_of(out)
        traffic = _traffic_inputs(grid)
        stale = _drop_stale(grid, there, before, traffic, rows_folder, user)
        done |= {key: row for key, row in there.items() if key not in stale and (row["succeeded"] or not retry_failed)}
        older = dict(before.get(CODE) or {}) if done else {}
        _write_manifest(out, command, grid, runfolder.INTERRUPTED, len(done), traffic, older)
        if done and (changed := _changed(before, manifest_of(out))):
            user.warn(
                f"the {len(done)} runs that {out} holds were made by another version of the software ({changed}); is "
                "that meant?"
            )
        if resume:
            user.tell(f"{len(done)} runs are kept, {len(grid.runs) - len(done)} are made")
        write_text(out / GRID, json.dumps(making.table, indent=2) + "\n")
        left_of = (Cell(tuple(run for run in cell.runs if run.key not in done)) for cell in grid.cells)
        cells = [cell for cell in left_of if cell.runs]
        # The densest first, so that no worker is left alone with it in the end.
        cells.sort(key=lambda cell: -(cell.config.traffic.density or 0.0) * len(cell.runs))
        # What was made of fewer runs goes.
        for name in (RUNS, SUMMARY, TABLE) if cells else ():
            (out / name).unlink(missing_ok=True)
        title = making.kind if not done else f"{making.kind} ({len(done)} of {len(grid.runs)} done before)"
        left = len(grid.runs) - len(done)
        with progress_bar(title, left, user.quiet, before=f"{title}: loading, warming up traffic") as advance:

            def keep(key: str, row: Row) -> None:
                if FULL_DISK in row:  # the row may find room, but tells nothing of the run
                    raise OSError(row[FULL_DISK], row["error"])
                write_row(rows_folder, key, without_nan(row))
                done[key] = row
                advance()

            execute(cells, keep)
        outcome = write_outcome(read_rows(rows_folder, (run.key for run in grid.runs)))
        _write_manifest(out, command, grid, runfolder.COMPLETE, len(grid.runs), traffic, older)
        return outcome


@contextmanager
def _ends_in_one_line(what: str, done: Mapping[str, Row], runs: int) -> Iterator[None]:
    """Turn an interrupt, and what the system refuses, a full disk for example, into an error that says what is kept."""
    fix = "continue with the same command and `resume`"
    try:
        yield
    except KeyboardInterrupt:
        raise RunInterruptedError(f"interrupted after {len(done)} of {runs} runs; {fix}") from None
    except (OSError, MemoryError) as error:
        kept = f"{len(done)} of {runs} runs are kept"
        raise RunError(f"{what} can't continue ({in_words(error)}); {kept}; fix this, then {fix}") from error


def _traffic_inputs(grid: GridPlan) -> dict[str, dict[str, str]]:
    """Return the SHA-256 of the files of each network or recording, by its name and theirs."""
    configs = {_place(cell.config): cell.config for cell in grid.cells}
    return {
        place: {f"{place}: {name}": sha256_of(path) for name, path in input_files(config).items()}
        for place, config in configs.items()
    }


def _of_both(older: str | None, now: str) -> str:
    """Return the hash of code by which a folder's rows were made: of two where some are older."""
    return now if older in (None, now) else older if older.endswith(now[:16]) else f"{older[:16]} and {now[:16]}"


def _place(config: RunConfig) -> str:
    return config.traffic.net if config.replay is None else Path(config.replay).name


def _write_manifest(
    out: Path,
    command: str,
    grid: GridPlan,
    status: str,
    runs: int,
    traffic: Mapping[str, Mapping[str, str]],
    older: Mapping[str, str],
) -> None:
    code, inputs = provenance_of(distinct_trackers(grid))
    code |= {name: _of_both(older.get(name), code[name]) for name in own_code()}
    inputs = dict(ChainMap(inputs, *map(dict, traffic.values())))
    files = hashes_of(out) if status == runfolder.COMPLETE else {}
    seed = grid.cells[0].config.seed
    write_manifest(out / runfolder.MANIFEST, RunFacts(status, command, seed, runs, inputs, code=code, files=files))


def _drop_stale(
    grid: GridPlan,
    there: Mapping[str, Row],
    before: Mapping[str, Any],
    traffic: Mapping[str, Mapping[str, str]],
    rows_folder: Path,
    user: Telling,
) -> set[str]:
    """Remove the rows whose tracker's module or model file, network or recording is another now; return their keys."""
    noted = dict(before.get(CODE) or {}) | dict(before.get(INPUTS) or {})
    stale: dict[str, set[str]] = {}
    for config in distinct_trackers(grid):
        for name, digest in (other_code(config) | model_files(config)).items():
            if noted.get(name, digest) != digest:
                keys = {run.key for run in grid.runs if run.config.tracker == config.tracker and run.key in there}
                stale.setdefault(name, set()).update(keys)
    for place, now in traffic.items():
        old = {name: digest for name, digest in noted.items() if name.startswith(f"{place}: ")}
        if old and old != now:
            keys = {run.key for run in grid.runs if _place(run.config) == place and run.key in there}
            stale.setdefault(place, set()).update(keys)
    for name, keys in stale.items():
        user.warn(f"{name} has changed since {len(keys)} runs with it were made; they are made again")
    every = {key for keys in stale.values() for key in keys}
    for key in every:
        (rows_folder / f"{key}.json").unlink(missing_ok=True)
    return every


def _changed(before: Mapping[str, Any], after: Mapping[str, Any]) -> str:
    """Return a sentence on the software that changed since a folder's runs were made; empty where none did."""
    names = []
    for table in ("versions", CODE):
        old, new = (dict(side.get(table) or {}) for side in (before, after))
        # The rows by the user's own modules that are others now are gone.
        known = own_code() if table == CODE else new
        names += [name for name in known if name in old and old[name] != new[name]]
    if not before:
        return "it is not known which"
    same = before.get("git_revision") == after.get("git_revision")
    return ", ".join(names) or ("" if same or before.get(CODE) else "revision")
