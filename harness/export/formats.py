"""The formats that a run can be exported to, each loaded only when it is asked for."""

from __future__ import annotations

import importlib
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from harness.errors import InputError
from harness.report.finished import RecordedRun, read_recorded_run
from harness.runfolder.checks import sound_tables

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


def export_run(folder: Path, name: str, out: Path | None = None, force: bool = False) -> list[Path]:
    """Write a run in a format and return the files.

    Args:
        folder: A finished run's folder.
        name: A key of ``FORMATS``.
        out: Folder to write; by default ``export/<format>`` in the run's folder, which may be replaced.
        force: Whether an existing ``out`` may be replaced.

    Raises:
        InputError: There is no such format, the package's part for it is not installed, the folder is no finished
            run's, or ``out`` exists.
    """
    exporter = _exporter(name)
    target = out if out is not None else folder / EXPORTS / name
    if target.exists() and out is not None and not force:
        raise InputError(f"`out`: {target} exists; choose another folder or add `force` to replace it")
    if target.exists() and not target.is_dir():
        raise InputError(f"`out`: {target} is a file; choose another folder")
    with sound_tables(folder, "folder"):
        run = read_recorded_run(folder)
    pending = target.with_name(f".{target.name}.running")
    shutil.rmtree(pending, ignore_errors=True)
    try:
        pending.mkdir(parents=True)
    except OSError as error:
        raise InputError(f"`out`: can't write in {target.parent}: {error.strerror}; choose another folder") from None
    try:
        with sound_tables(folder, "folder"):
            files = exporter(run, pending)
    except BaseException:
        shutil.rmtree(pending, ignore_errors=True)
        raise
    if target.exists():
        shutil.rmtree(target)
    pending.rename(target)
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
        raise InputError(
            f"`to`: {name} needs {error.name}; install it with: pip install 'mmpf-harness[{chosen.extra}]'"
        ) from None
    return exporter
