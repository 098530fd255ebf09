"""Puts an export into place as one file, and packs files by gzip so that equal content gives equal bytes."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Sequence
from pathlib import Path

from harness.common.errors import InputError
from harness.common.untrusted_files import unpacked

SUFFIXES = (".xml", ".csv")
HEAD_BYTES = 1 << 16
LEVEL = 6


def pending_of(target: Path) -> Path:
    """Return the folder in which an export is written before it is moved to its place."""
    return target.with_name(f".{target.name}.exporting")


def target_of(pending: Path) -> Path:
    """Return the place to which an export's folder is moved once it is written."""
    return pending.with_name(pending.name.removeprefix(".").removesuffix(".exporting"))


def pack(files: Sequence[Path]) -> list[Path]:
    """Pack the files of text formats, each under its name with ``.gz``; the plain ones go."""
    return [_packed(file) if file.suffix in SUFFIXES else file for file in files]


def _packed(file: Path) -> Path:
    path = file.with_name(f"{file.name}.gz")
    # Neither name nor time go into the file, which would differ from one export to the next.
    with file.open("rb") as plain, path.open("wb") as target, gzip.GzipFile("", "wb", LEVEL, target, mtime=0) as packed:
        shutil.copyfileobj(plain, packed)
    file.unlink()
    return path


def check_replaceable_file(path: Path, element: str, force: bool) -> None:
    """Refuse to replace a file without ``--force``, or one that is not such an export.

    Args:
        path: The file.
        element: The XML element that it begins with if it is such an export.
        force: Whether an earlier export may be replaced.

    Raises:
        InputError: The file must not be replaced.
    """
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
