"""The export formats, each loaded only when it is used.

Another package's is a function like those here, ``export(run, folder)``: it writes into the folder, which is empty, and
returns the files. It is found by ``module:function``, or as an entry point.
"""

import gzip
import re
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from harness.common.error_text import what_it_raised
from harness.common.errors import InputError
from harness.common.files import check_unlinked, writing
from harness.common.streams import streams_and_depth_kept
from harness.common.untrusted_files import unpacked
from harness.running.finished import RecordedRun, read_recorded_run
from harness.storage import ownership
from harness.storage import run_folder as runfolder
from harness.storage.checks import sound_tables
from harness.storage.grid_folder import RUNS
from harness.truth.recorded.fcd import types_file
from mmpf.registry import Entry, Registry, UnknownNameError

Exporter = Callable[[Any, Path], list[Path]]
"""What it takes is a ``RecordedRun``, or of ``OF_FOLDERS`` the folder."""
EXPORTS = "export"
XML_FILES = (".xml", ".xml.gz")
PACKED = ("csv", "fcd")
"""Formats whose files can be packed by gzip."""
OF_FOLDERS = ("mlflow", "trackio")
"""Formats of which an exporter takes the folder: a grid's too."""
export_formats: Registry[Callable[..., object]] = Registry(
    "export format",
    "harness.export_formats",
    {
        "autoware": Entry("harness.export.autoware_bag:export", "a ROS 2 bag (MCAP) of Autoware's messages", "mcap"),
        "csv": Entry("harness.export.csv_tables:export", "every table as comma-separated values"),
        "fcd": Entry("harness.export.fcd:export", "truth as SUMO floating-car data, XML"),
        "kitti": Entry(
            "harness.export.kitti:export",
            "tracks of a kitti-tracking recording in KITTI's layout, as AB3DMOT's evaluation reads it",
        ),
        "mot": Entry(
            "harness.export.mot:export", "ground truth and tracker in MOTChallenge's layout, as TrackEval reads it"
        ),
        "mcap": Entry("harness.export.mcap_recording:export", "a recording in Foxglove's schemas", "mcap"),
        "osi": Entry("harness.export.osi:export", "ASAM OSI ground truth and sensor data, binary traces", "osi"),
        "scans": Entry("harness.export.scans:export", "what a tracker is shown, for one that runs elsewhere"),
        "mlflow": Entry("harness.export.mlflow_store:export", "metrics, settings and page in MLflow", "mlflow"),
        "trackio": Entry("harness.export.trackio_store:export", "metrics, settings and page in Trackio", "trackio"),
        "rerun": Entry("harness.export.rerun_recording:export", "a recording for the rerun viewer", "viewer"),
    },
    "there is no format {name!r}; choose from {in_order}, or module:function for your own",
)


@streams_and_depth_kept()
def export_run(
    folder: Path,
    name: str,
    out: Path | None = None,
    force: bool = False,
    tell: Callable[[str], object] = str,
    packed: bool = False,
) -> list[Path]:
    """Write a finished run, or a grid for ``OF_FOLDERS``, in a format and return the files, perhaps packed by gzip.

    The folder is by default ``export/<format>`` in the run's, which may be replaced, as an earlier export in ``out``
    may by ``force``; ``tell`` is called with a line about that. Of ``fcd`` it may be a file, ``.xml`` or ``.xml.gz``.

    Raises:
        InputError: There is no such format, the package's part for it is not installed, the folder is no finished
            run's, or ``out`` exists, is no export, holds somebody's files or can't be written; or a format of another
            package fails.
        RunError: There is no room.
    """
    exporter = _exporter(name)
    if packed and name not in PACKED:
        raise InputError(f"`gzip`: only {' and '.join(PACKED)} are packed; leave it out")
    if out is not None and name == "fcd" and out.name.endswith(XML_FILES):
        return _export_to_file(folder, exporter, out, force)
    if name not in OF_FOLDERS and (folder / RUNS).is_file():
        told = f"{folder} holds many runs, which only {' and '.join(OF_FOLDERS)} take; give one run's folder"
        raise InputError(f"`folder`: {told} ('stress --keep runs' keeps them)")
    target = out if out is not None else folder / EXPORTS / re.sub(r"[^\w.+-]+", "-", name)
    replaces = force or out is None
    check_unlinked(folder, [target] if out is None else [], "folder")
    runfolder.check_free(target, replaces, ownership.EXPORT)
    with sound_tables(folder, "folder"):
        results = folder if name in OF_FOLDERS else read_recorded_run(folder)
    pending = runfolder.open_folder(target, "", replaces, ownership.EXPORT)
    try:
        with writing("out", target), sound_tables(folder, "folder"):
            files = exporter(results, pending.path)
            files = list(map(_packed, files)) if packed else files
            if pending.replaced is not None:
                tell(f"replaced {pending.replaced}")
            written = pending.finish()
    except BaseException:
        pending.discard()
        raise
    return [written / file.relative_to(pending.path) for file in files]


def _export_to_file(folder: Path, exporter: Exporter, out: Path, force: bool) -> list[Path]:
    """Write floating-car data to a file, packed if its name says so, and the vehicle types to one beside it."""
    targets = (out, types_file(out))
    for target, element in zip(targets, ("fcd-export", "additional"), strict=True):
        check_replaceable_file(target, element, force)
    with writing("out", out):
        out.parent.mkdir(parents=True, exist_ok=True)
        with (
            sound_tables(folder, "folder"),
            tempfile.TemporaryDirectory(prefix=".exporting-", dir=out.parent) as pending,
        ):
            main, types = exporter(read_recorded_run(folder), Path(pending))
            (_packed(main) if out.suffix == ".gz" else main).replace(out)
            types.replace(targets[1])
    return list(targets)


def _exporter(name: str) -> Exporter:
    """Return a format's exporter; the failures of another package's are the user's to fix."""
    try:
        export = export_formats[name]
    except UnknownNameError as error:
        told = f"`to` {name}" if export_formats.is_outside(name) else "`to`"
        raise InputError(f"{told}: {error}") from None
    if name in export_formats.own:
        return cast(Exporter, export)

    def checked(run: RecordedRun, folder: Path) -> list[Path]:
        try:
            files = export(run, folder)
            fault = _fault_of(files, folder)
        except InputError:
            raise
        except Exception as error:
            fault = f"exporting {run.folder} failed ({what_it_raised(error)})"
            raise InputError(f"`to` {name}: {fault}; fix the format's function") from error
        if fault:
            raise InputError(f"`to` {name}: it returned {fault}; fix the format's function")
        return list(cast("list[Path]", files))

    return checked


def _fault_of(files: object, folder: Path) -> str:
    """Return what is wrong with what an exporter returned; empty if nothing is."""
    if not isinstance(files, list | tuple):
        return f"{type(files).__name__}, not the list of written paths"
    if odd := [type(file).__name__ for file in files if not isinstance(file, Path)]:
        return f"a list with {odd[0]}, not the list of written paths"
    strange = [file for file in files if not (file.is_file() and file.resolve().is_relative_to(folder.resolve()))]
    return f"{strange[0]}, which is not a file in the given folder" if strange else "" if files else "no file"


HEAD_BYTES = 1 << 16
LEVEL = 6


def _packed(file: Path) -> Path:
    """Pack a file by gzip under its name with ``.gz``; the plain one goes."""
    path = file.with_name(f"{file.name}.gz")
    # Neither name nor time go into the file, which would differ from one export to the next.
    with file.open("rb") as plain, path.open("wb") as target, gzip.GzipFile("", "wb", LEVEL, target, mtime=0) as packed:
        shutil.copyfileobj(plain, packed)
    file.unlink()
    return path


def check_replaceable_file(path: Path, element: str, force: bool) -> None:
    """Refuse to replace a file without ``--force``, or one that does not begin with an export's XML element."""
    if not path.exists():
        return
    if not force:
        raise InputError(f"`out`: {path} exists; choose another file or add `force` to replace it")
    try:
        with unpacked(path) as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise InputError(f"`out`: can't replace {path}: {error.strerror}; choose another file") from None
    if f"<{element}".encode() not in head:
        raise InputError(f"`out`: {path} is not an earlier export; choose another file")
