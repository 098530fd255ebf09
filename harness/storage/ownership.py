"""Which folders and files this program made; it never removes others.

A folder that a later command may replace holds a ledger: the program, the kind of the folder, and every file that was
written to it. Only listed files are removed, so what a user puts beside them survives whatever the ledger says.
"""

import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from harness.common.errors import InputError
from harness.common.files import is_temporary, write_text
from harness.common.untrusted_files import read_json
from harness.storage.lock import LOCK

LEDGER = ".mmpf-harness.json"
PROGRAM = "mmpf-harness"
RUN, STRESS, EXPORT, DRIVE = "run", "stress", "export", "drive"
IN_WORDS = {RUN: "a run", STRESS: "a stress test", EXPORT: "an export", DRIVE: "a closed loop"}


def plain(kind: str) -> str:
    """Return what a kind of folder is called, without its article."""
    return IN_WORDS[kind].partition(" ")[2]


def claim(folder: Path, kind: str) -> None:
    """Write a ledger without files into a folder that was just made."""
    _write(folder, kind, ())


def record_all(folder: Path, kind: str) -> None:
    """Write the list of this program's files for a folder that holds no others."""
    _write(folder, kind, (name for name in _files(folder) if name != LEDGER))


def add(folder: Path, files: Iterable[Path]) -> None:
    """Add files of a later command to a folder's list; do nothing where there is no list."""
    if (known := _read(folder)) is not None:
        kind, listed = known
        _write(folder, kind, listed | {file.relative_to(folder).as_posix() for file in files})


def kind_of(folder: Path) -> str | None:
    """Return what kind of folder this program has made; None for anybody else's."""
    known = _read(folder)
    return None if known is None else known[0]


def strangers(folder: Path) -> list[str]:
    """Return the files in a folder with a ledger that this program has not written, links too."""
    own = _own(folder)
    return [name for name in _files(folder) if name not in own]


def check_replaceable(folder: Path, kind: str) -> None:
    """Check that a folder may be replaced: empty, or made by this program, of this kind, without other files."""
    fix = "choose another folder, or remove it yourself"
    if folder.is_symlink():
        raise InputError(f"`out`: {folder} is a link; give the folder that it leads to")
    if not folder.is_dir():
        raise InputError(f"`out`: {folder} is a file; choose another folder")
    if not any(folder.iterdir()):
        return
    found = kind_of(folder)
    if found is None:
        raise InputError(f"`out`: {folder} was not made by this program and is not replaced; {fix}")
    if found != kind:
        raise InputError(f"`out`: {folder} is {IN_WORDS[found]}, not {IN_WORDS[kind]}; {fix}")
    if others := strangers(folder):
        count = f" and {len(others) - 1} more" if len(others) > 1 else ""
        raise InputError(
            f"`out`: {folder} holds {others[0]}{count}, which this program did not write; move it away, or {fix}"
        )


def described(folder: Path) -> str:
    """Return a phrase on what would be removed with a folder."""
    own = _own(folder)
    files = [folder / name for name in _files(folder) if name in own]
    size_mb = sum(file.lstat().st_size for file in files) / 1e6
    kind = kind_of(folder)
    what = "an empty folder" if kind is None else f"{IN_WORDS[kind]}, {len(files)} files, {size_mb:.1f} MB"
    return f"{folder}: {what}"


def remove(folder: Path) -> None:
    """Remove what this program has written in a folder, and the folder itself if nothing else is left in it."""
    own = _own(folder)
    for name in _files(folder):
        if name in own and name != LEDGER:
            (folder / name).unlink(missing_ok=True)
    for path, _, _ in os.walk(folder, topdown=False):
        if Path(path) != folder and not os.listdir(path):
            Path(path).rmdir()
    if all(entry.name == LEDGER for entry in folder.iterdir()):
        # Last, so that a removal that was cut short can be told from a stranger's folder.
        (folder / LEDGER).unlink(missing_ok=True)
        folder.rmdir()


def _files(folder: Path) -> Iterator[str]:
    """Yield names below a folder of everything that is no folder; links are not followed."""
    for path, folders, files in os.walk(folder):
        below = Path(path)
        names = [*files, *(name for name in folders if (below / name).is_symlink())]
        for name in sorted(names):
            yield (below / name).relative_to(folder).as_posix()


def _own(folder: Path) -> set[str]:
    """Return the names of the files that this program has written, of exports within a run too."""
    own: set[str] = set()
    for path, _, files in os.walk(folder):
        below = Path(path)
        known = _read(below)
        # A run within a run is a result of its own.
        counts = known is not None and (below == folder or known[0] == EXPORT)
        listed = {LEDGER, LOCK, *known[1]} if known is not None and counts else set()
        listed |= {name for name in files if is_temporary(name)}
        within = (name for name in listed if not Path(name).is_absolute() and ".." not in Path(name).parts)
        own |= {(below / name).relative_to(folder).as_posix() for name in within}
    return own


def _read(folder: Path) -> tuple[str, set[str]] | None:
    """Return a ledger's kind and files; None where there is no ledger of this program's."""
    path = folder / LEDGER
    try:
        ledger = read_json(path) if path.is_file() and not path.is_symlink() else None
    except (OSError, ValueError):
        return None
    if ledger is None or ledger.get("program") != PROGRAM or str(ledger.get("kind")) not in IN_WORDS:
        return None
    files = ledger.get("files")
    return str(ledger["kind"]), {name for name in files if isinstance(name, str)} if isinstance(files, list) else set()


def _write(folder: Path, kind: str, files: Iterable[str]) -> None:
    ledger = {"program": PROGRAM, "kind": kind, "files": sorted(set(files))}
    write_text(folder / LEDGER, json.dumps(ledger, indent=1) + "\n")
