"""Limits on what is opened: files from elsewhere are refused by their kind and size before anything of them is read."""

from __future__ import annotations

import gzip
import io
import math
import os
import stat
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO, cast

from harness.common.errors import InputError

MB = 1 << 20
LONGEST_NAME_BYTES = 255
GZIP = b"\x1f\x8b"
MOST_SETTINGS_BYTES, MOST_JSON_BYTES, MOST_TABLE_BYTES = 4 * MB, 64 * MB, 4096 * MB


def checked_path(path: Path, parameter: str) -> Path:
    """Return a path that the system can have.

    Args:
        path: What the user or a file named.
        parameter: Parameter that named it, for the message.

    Raises:
        InputError: A part of it is longer than a name may be, or holds what no name may.
    """
    if "\0" in str(path):
        raise InputError(f"`{parameter}`: there is a null character in the path {str(path)[:60]!r}; leave it out")
    long = [part for part in path.parts if len(os.fsencode(part)) > LONGEST_NAME_BYTES]
    if long or len(os.fsencode(path)) > 4095:
        shown = (long or [str(path)])[0][:40]
        raise InputError(f"`{parameter}`: the name {shown}... is too long; {LONGEST_NAME_BYTES} bytes are the most")
    return path


def check_file(path: Path, most_bytes: int, parameter: str | None = None) -> None:
    """Refuse what is there but is no ordinary file, such as a pipe, which would never end, and what is too large.

    A file that is missing passes: whoever reads it says so in words of its own.

    Args:
        path: The file.
        most_bytes: How large it may be.
        parameter: Parameter that named it, for the message; None where the file alone is named.

    Raises:
        InputError: It is a pipe, a device or a socket, larger than that, or can't be looked at.
    """
    place = f"`{parameter}`: {path}" if parameter else str(path)
    checked_path(path, parameter or "file")
    try:
        found = path.stat()
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputError(f"{place}: can't be read: {error.strerror}; choose another file") from None
    if stat.S_ISDIR(found.st_mode):
        raise InputError(f"{place} is a folder; give a file")
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{place} is a pipe or a device; give an ordinary file")
    if found.st_size > most_bytes:
        raise InputError(f"{place} has {found.st_size / MB:.0f} MB; at most {most_bytes / MB:.0f} MB are read")


def number(text: str) -> float:
    """Read a finite number as files write it: Python alone takes ``1_0`` for 10, and digits of other scripts.

    Raises:
        ValueError: It is none; the message says what stands there.
    """
    try:
        value = float(text) if "_" not in text and text.isascii() else math.nan
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]!r} is no number")
    return value


@contextmanager
def unpacked(path: Path, most_bytes: int) -> Iterator[BinaryIO]:
    """Open a file that may be packed by gzip, whatever its name, for reading its content.

    Args:
        path: The file.
        most_bytes: How much a packed file may hold.

    Raises:
        InputError: On reading: it holds more than that, or is no whole gzip file.
        OSError: It can't be opened.
    """
    with path.open("rb") as plain:
        if plain.read(len(GZIP)) != GZIP:
            plain.seek(0)
            yield plain
            return
        plain.seek(0)
        with gzip.open(plain) as packed, io.BufferedReader(_Limited(packed, path, most_bytes)) as all_of:
            yield cast("BinaryIO", all_of)


class _Limited(io.RawIOBase):
    """What is packed in a file, of which no more is read than allowed, however well it was compressed."""

    def __init__(self, packed: gzip.GzipFile, path: Path, most_bytes: int) -> None:
        self._packed, self._path, self._most_bytes, self._read = packed, path, most_bytes, 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: bytearray | memoryview) -> int:  # type: ignore[override]
        try:
            part = self._packed.read(min(len(buffer), MB))
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise InputError(f"{self._path}: broken or truncated gzip: {error}") from None
        self._read += len(part)
        if self._read > self._most_bytes:
            raise InputError(f"{self._path}: more than {self._most_bytes / MB:.0f} MB when unpacked")
        buffer[: len(part)] = part
        return len(part)
