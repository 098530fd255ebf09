"""The formats that a run can be exported to, each loaded only when it is asked for."""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from harness.errors import InputError
from harness.report.finished import RecordedRun, read_recorded_run
from harness.runfolder import ownership
from harness.runfolder.checks import sound_tables
from harness.runfolder.lock import lock_beside

Exporter = Callable[[RecordedRun, Path], list[Path]]
EXPORTS = "export"


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        description: What is written, in one line.
        module: Module with a function ``export(run, folder)`` that writes into the folder and returns the files.
        extra: Optional part of the package that it needs.
    """

    description: str
    module: str
    extra: str | None = None


FORMATS = {
    "csv": Format("every table as comma-separated values", "harness.export.csv_tables"),
    "fcd": Format("truth as SUMO floating-car data, XML", "harness.export.fcd"),
    "mot": Format("ground truth and tracker in MOTChallenge's layout, as TrackEval reads it", "harness.export.mot"),
    "osi": Format("ASAM OSI ground truth and sensor data, binary traces", "harness.export.osi", "osi"),
    "rerun": Format("a recording for the rerun viewer", "harness.export.rerun_recording", "viewer"),
}


def export_run(
    folder: Path,
    name: str,
    out: Path | None = None,
    force: bool = False,
    tell: Callable[[str], object] = str,
) -> list[Path]:
    """Write a run in a format and return the files.

    Args:
        folder: A finished run's folder.
        name: A key of ``FORMATS``.
        out: Folder to write; by default ``export/<format>`` in the run's folder, which may be replaced.
        force: Whether an earlier export in ``out`` may be replaced.
        tell: Called with a line about what is replaced.

    Raises:
        InputError: There is no such format, the package's part for it is not installed, the folder is no finished
            run's, or ``out`` exists, is no export, holds somebody's files or can't be written.
    """
    exporter = _exporter(name)
    target = out if out is not None else folder / EXPORTS / name
    if target.exists():
        if out is not None and not force:
            raise InputError(f"`out`: {target} exists; choose another folder or add `force` to replace it")
        ownership.check_replaceable(target, ownership.EXPORT, "out")
    with sound_tables(folder, "folder"):
        run = read_recorded_run(folder)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        lock = lock_beside(target, "out")
    except OSError as error:
        raise InputError(f"`out`: can't write in {target.parent}: {error.strerror}; choose another folder") from None
    # Within the lock nobody else writes here; what a killed export left goes.
    pending = target.with_name(f".{target.name}.exporting")
    try:
        if ownership.kind_of(pending) == ownership.EXPORT:
            shutil.rmtree(pending)
        pending.mkdir(exist_ok=not pending.is_symlink() and pending.is_dir() and not any(pending.iterdir()))
        ownership.claim(pending, ownership.EXPORT)
        with sound_tables(folder, "folder"):
            files = exporter(run, pending)
        ownership.record_all(pending, ownership.EXPORT)
        if target.exists():
            tell(f"replaced {ownership.described(target)}")
            ownership.check_replaceable(target, ownership.EXPORT, "out")
            ownership.remove(target)
        pending.rename(target)
    except OSError as error:
        raise InputError(f"`out`: can't write {target}: {error.strerror or error}; choose another folder") from None
    finally:
        if ownership.kind_of(pending) == ownership.EXPORT:
            shutil.rmtree(pending, ignore_errors=True)
        lock.release()
    return [target / file.relative_to(pending) for file in files]


def _exporter(name: str) -> Exporter:
    if name not in FORMATS:
        raise InputError(f"`to`: there is no format {name!r}; choose from {', '.join(FORMATS)}")
    chosen = FORMATS[name]
    try:
        exporter: Exporter = importlib.import_module(chosen.module).export
    except ModuleNotFoundError as error:
        if chosen.extra is None:
            raise
        raise InputError(f"`to`: {name} needs {error.name}; install it with: pip install '.[{chosen.extra}]'") from None
    return exporter
