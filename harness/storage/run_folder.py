"""A run's folder: written under a temporary name, renamed when the run is done, read for replay and reports."""

import os
import platform
import re
import shutil
from collections.abc import Collection
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.compute as pc

from harness.common.bounds import check_columns
from harness.common.errors import InputError, RunError
from harness.common.files import writing
from harness.common.untrusted_files import checked_path, read_json, read_toml, reading
from harness.storage import ownership
from harness.storage.checks import AGAIN, check_kinds, read_parquet
from harness.storage.grid_folder import flattened
from harness.storage.lock import FolderLock, lock_beside, remove_stale_locks
from harness.storage.manifest import manifest_of
from harness.storage.schema import TABLES, Table

CONFIG, MANIFEST, METRICS, ROAD = "config.toml", "manifest.json", "metrics.json", "road.json"
TRUTH, DETECTIONS, TRACKS = "truth.parquet", "detections.parquet", "tracks.parquet"
ERRORS, EVENTS, DIAGNOSTICS = "errors.parquet", "events.parquet", "diagnostics.parquet"
PARTICLES, UNSEEN = "particles.parquet", "unseen.parquet"
BRAKINGS, COMMANDS = "brakings.parquet", "commands.parquet"
FIGURES, PAGE, BESIDE = "figures", "report.html", "side-by-side.html"
COMPLETE, INTERRUPTED, FAILED = "complete", "interrupted", "failed"
DEFAULT_PARENT = Path("results")
INCOMPLETE_SUFFIX = ".incomplete"


@dataclass(frozen=True)
class PendingFolder:
    """A folder of a run or an export that is being written at ``path``, and gets its ``final`` name once finished.

    ``force`` says whether it may replace an earlier one of its kind there; ``lock`` keeps other processes off that
    name, None where nobody asked for it.
    """

    path: Path
    final: Path
    force: bool = False
    lock: FolderLock | None = None
    kind: str = ownership.RUN

    @property
    def replaced(self) -> str | None:
        """A phrase on what will be removed for this folder; None if nothing."""
        return ownership.described(self.final) if self.force and self.final.exists() else None

    def finish(self) -> Path:
        """Give the folder its final name and return it; if another run took that name meanwhile, the next free one."""
        ownership.record_all(self.path, self.kind)
        if not (self.force and self.final.exists() and _is_replaceable(self.final, self.kind)):
            # Also where somebody's files came into the folder since then: they stay, and so does what was written.
            return self._take_name(self.final)
        aside = self.final.with_name(f".{self.final.name}.replaced-{os.getpid()}@{platform.node()}")
        self.final.rename(aside)
        taken = self._take_name(self.final)
        ownership.remove(aside)
        return taken

    def leave_incomplete(self) -> Path:
        """Rename the folder to show that the run did not end, and return it."""
        # On a full disk the ledger stays as it was: nothing will replace the folder, and its rows are kept.
        with suppress(OSError):
            ownership.record_all(self.path, ownership.RUN)
        marked = self.final.with_name(self.final.name + INCOMPLETE_SUFFIX)
        if marked.exists() and _is_replaceable(marked):
            ownership.remove(marked)
        return self._take_name(marked)

    def discard(self) -> None:
        """Remove the folder."""
        shutil.rmtree(self.path, ignore_errors=True)
        self._release()

    def _take_name(self, wanted: Path) -> Path:
        try:
            return self.path.rename(_first_free(wanted))
        finally:
            self._release()

    def _release(self) -> None:
        if self.lock is not None:
            self.lock.release()


def open_folder(out: Path | None, default_name: str, force: bool, kind: str = ownership.RUN) -> PendingFolder:
    """Make a folder for a new run, or an export, which may replace an earlier one by ``force``.

    Without ``out`` the run lands in ``results/<default_name>``, or in ``<default_name>-2``, ``-3``, ... where that is
    taken.

    Raises:
        InputError: The folder exists and may not be replaced, can't be written, or another process is writing it; or
            none is named that ``force`` could replace.
    """
    if force and out is None:
        raise InputError("`force`: it replaces the run in `out`, and there is none; name that folder, or leave it out")
    final = _first_free(DEFAULT_PARENT / default_name) if out is None else checked_path(out, "out")
    # PyArrow takes ~ for the user's own folder.
    final = final if final.name and not str(final).startswith("~") else final.absolute()
    with writing("out", final):
        check_free(final, force, kind)
        final.parent.mkdir(parents=True, exist_ok=True)
        lock = lock_beside(final) if out is not None else None
    pending = final.with_name(f".{final.name}.running-{os.getpid()}@{platform.node()}")
    try:
        # Whoever held the lock a moment ago may have finished.
        check_free(final, force, kind)
        with writing("out", final):
            pending.mkdir()
            ownership.claim(pending, kind)
    except (InputError, RunError):
        with suppress(OSError):
            pending.rmdir()
        if lock is not None:
            lock.release()
        raise
    _remove_leftovers(final.parent)
    return PendingFolder(pending, final, force, lock, kind)


def final_of(pending: Path) -> Path:
    """Return the place to which a folder that is being written is moved."""
    return pending.with_name(pending.name[1:].rpartition(".running-")[0])


def check_free(final: Path, force: bool, kind: str = ownership.RUN) -> None:
    """Refuse a place where something is, unless ``force`` may replace it, which is of that kind."""
    if os.path.lexists(final):
        if not force:
            raise InputError(f"`out`: {final} exists; choose another folder or add `force` to replace it")
        ownership.check_replaceable(final, kind)


def _is_replaceable(folder: Path, kind: str = ownership.RUN) -> bool:
    try:
        ownership.check_replaceable(folder, kind)
    except (InputError, OSError):
        return False
    return True


def is_run_folder(path: Path) -> bool:
    """Return whether a path is a folder that a run has left, finished or not."""
    return (path / MANIFEST).is_file() or (path / CONFIG).is_file()


def read_manifest(folder: Path, parameter: str, *, ended: bool = True) -> dict[str, Any]:
    """Return the manifest of a run folder; unless it need not have ``ended``, of a whole run.

    Raises:
        InputError: The folder is not a run's folder, or the run did not end.
    """
    if not (manifest := manifest_of(folder, parameter)):
        raise InputError(f"`{parameter}`: {folder} is not a run's folder: {MANIFEST} is missing or broken")
    if ended and manifest.get("status") != COMPLETE:
        raise InputError(
            f"`{parameter}`: the run in {folder} did not end, so that it has no scores; run it again, or score its "
            f"finished steps: `python -m harness score --truth {folder} --tracks {folder}`"
        )
    return manifest


def read_metrics(folder: Path, parameter: str) -> dict[str, Any]:
    """Return the content of a run's ``metrics.json``."""
    with reading(f"`{parameter}`: {folder / METRICS}", "scores of a run"):
        metrics = read_json(folder / METRICS, parameter)
        if not isinstance(metrics.get("run", {}), dict):
            raise ValueError("run is no table")
        if odd := [name for name, value in flattened(metrics).items() if isinstance(value, list | dict)]:
            raise ValueError(f"{odd[0]} is no number")
        return metrics


def read_config_table(folder: Path, parameter: str) -> dict[str, Any]:
    """Return the recorded configuration of a run folder as a nested table."""
    if folder.is_dir() and not (folder / CONFIG).exists():
        raise InputError(
            f"`{parameter}`: {folder} has no {CONFIG}; give one run's folder (`stress --keep runs` keeps them)"
        )
    return read_toml(folder / CONFIG, parameter)


def read_table(
    folder: Path, name: str, parameter: str, columns: Collection[str] | None = None, wanted: pc.Expression | None = None
) -> pd.DataFrame:
    """Return one of the tables of a run folder.

    Args:
        parameter: Parameter that named the folder, for the message.
        columns: Columns that it must have, whose content is checked; None for all that its kind of table has.
        wanted: Which rows, as an expression of PyArrow; None for all.

    Raises:
        InputError: It is missing, truncated, not parquet, lacks columns, or is not as the run left it.
    """
    path = folder / name
    if not path.exists():
        raise InputError(f"`{parameter}`: {path} is missing; make the run again")
    manifest = manifest_of(folder)
    rows = manifest.get("rows")
    table = read_parquet(path, parameter, wanted, rows.get(name) if isinstance(rows, dict) else None)
    if manifest.get("status") in (INTERRUPTED, FAILED):
        later = sorted(folder.glob(f"{path.stem}-[0-9]*{path.suffix}"), key=lambda part: (len(part.name), part.name))
        table = pd.concat([table, *(read_parquet(part, parameter, wanted) for part in later)], ignore_index=True)
    known = TABLES.get(name, Table("", ()))
    check_columns(f"`{parameter}`: {path}", table.columns, known.needed if columns is None else columns, AGAIN)
    checked = [column.name for column in known.columns if column.name in table] if columns is None else columns
    check_kinds(table, map(known.of, checked), f"`{parameter}`: {path}")
    if known.in_order and "step" in checked and (np.diff(table["step"].to_numpy(dtype=np.float64)) < 0.0).any():
        raise InputError(f"`{parameter}`: {path}: its rows are not in the order of time; make the run again")
    return table


def _first_free(path: Path) -> Path:
    candidate, number = path, 2
    while os.path.lexists(candidate):
        candidate = path.with_name(f"{path.name}-{number}")
        number += 1
    return candidate


def _remove_leftovers(parent: Path) -> None:
    """Remove the folders of runs and exports that were killed: those whose process, of this machine, lives no more."""
    ours = re.compile(rf"\..+\.(?:running|replaced)-([0-9]+)@{re.escape(platform.node())}")
    remove_stale_locks(parent)
    for folder in parent.glob(".*"):
        name = ours.fullmatch(folder.name)
        if name is None or _lives(int(name.group(1))) or folder.is_symlink() or not folder.is_dir():
            continue
        if ".replaced-" in folder.name:
            final = folder.with_name(folder.name[1:].rpartition(".replaced-")[0])
            # Killed between two renamings, the new run had not taken the old one's place yet.
            ownership.remove(folder) if os.path.lexists(final) else folder.rename(final)
        elif is_run_folder(folder) or ownership.kind_of(folder) is not None or not any(folder.iterdir()):
            shutil.rmtree(folder, ignore_errors=True)


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except (OSError, OverflowError) as error:
        return not isinstance(error, ProcessLookupError)
    return True
