"""Limits on external files: their kind and size are checked before anything is read."""

import gzip
import json
import math
import os
import stat
import tomllib
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, cast

from harness.common.error_text import is_own_fault
from harness.common.errors import InputError

MB = 1 << 20
LONGEST_NAME_BYTES = 255
GZIP = b"\x1f\x8b"
MOST_TEXT_BYTES = 16 * MB


def checked_path(path: Path, parameter: str) -> Path:
    """Return a path that the system can have.

    Raises:
        InputError: A part of it is longer than a name may be, or holds what no name may.
    """
    if "\0" in str(path):
        raise InputError(f"`{parameter}`: there is a null character in the path {str(path)[:60]!r}; leave it out")
    end = 0xE000 if parameter == "out" else 0xDC80  # PyArrow writes only where the name is valid UTF-8
    if not str(path).isprintable() and any(0xD800 <= ord(letter) < end for letter in str(path)):
        raise InputError(f"`{parameter}`: the path {ascii(str(path))[:60]} is not valid text; give it in UTF-8")
    long = [part for part in path.parts if len(os.fsencode(part)) > LONGEST_NAME_BYTES]
    if long or len(os.fsencode(path)) > 4095:
        shown = (long or [str(path)])[0][:40]
        raise InputError(f"`{parameter}`: the name {shown}... is too long; {LONGEST_NAME_BYTES} bytes are the most")
    return path


def check_file(path: Path, parameter: str | None = None) -> None:
    """Refuse what is there but is not a regular file, such as a pipe, which would never end.

    A file that is missing passes: whoever reads it says so in words of its own.

    Args:
        parameter: Parameter that named it, for the message; None where the file alone is named.

    Raises:
        InputError: It is a pipe, a device or a socket, or can't be looked at.
    """
    place = f"`{parameter}`: {path}" if parameter else str(path)
    try:
        kind = checked_path(path, parameter or "file").stat().st_mode
    except FileNotFoundError:
        return
    except OSError as error:
        raise InputError(f"{place}: can't be read: {error.strerror}; choose another file") from None
    if not stat.S_ISREG(kind):
        what = "folder; give a file" if stat.S_ISDIR(kind) else "pipe or a device; give an ordinary file"
        raise InputError(f"{place} is a {what}")


def require_file(path: Path, place: object) -> None:
    """Refuse what is no regular file.

    Raises:
        InputError: It does not exist, or is a folder, a pipe or a device.
    """
    if not path.is_file():
        raise InputError(f"{place}: {path.name} does not exist, or is not a regular file")


def read_text(path: Path, parameter: str | None = None) -> str:
    """Return the text of a file of settings or results.

    Raises:
        InputError: It is not a regular file, or larger than any that is written.
        OSError: It can't be read.
        ValueError: It is not UTF-8.
    """
    check_file(path, parameter)
    if (size := path.stat().st_size) > MOST_TEXT_BYTES:
        place = f"`{parameter}`: {path}" if parameter else str(path)
        raise InputError(f"{place} has {size / MB:.0f} MB; at most {MOST_TEXT_BYTES / MB:.0f} MB are read")
    return path.read_text(encoding="utf-8")


def read_json(path: Path, parameter: str | None = None) -> dict[str, Any]:
    """Return the content of a JSON file of settings or results, which is a table.

    Raises:
        InputError: It is not a regular file, or larger than any that is written.
        OSError: It can't be read.
        ValueError: It is not UTF-8, no table in JSON, or nested too deeply.
    """
    try:
        content = json.loads(read_text(path, parameter))
    except RecursionError:
        raise ValueError("it is nested too deeply") from None
    if not isinstance(content, dict):
        raise ValueError("it is no table")
    return content


def read_toml(path: Path, parameter: str) -> dict[str, Any]:
    """Return the content of a TOML file of settings, unchecked.

    Raises:
        InputError: It can't be read, or is no TOML.
    """
    with reading(f"`{parameter}`: {path}", "TOML file"):
        return tomllib.loads(read_text(path, parameter))


def number_or_nan(text: str) -> float:
    """Return the number that a file's text is, nan if none; Python alone takes ``1_0`` or other scripts' digits."""
    try:
        return float(text) if "_" not in text and text.isascii() else math.nan
    except ValueError:
        return math.nan


def number(text: str) -> float:
    """Read a finite number as files write it.

    Raises:
        ValueError: It is none; the message says what stands there.
    """
    value = number_or_nan(text)
    if not math.isfinite(value):
        raise ValueError(f"{text[:40]!r} is not a number")
    return value


@contextmanager
def reading(path: object, what: str) -> Iterator[None]:
    """Turn whatever fails over a file's content into one line that names the file; a fault of this program passes.

    Args:
        path: The file, after the option that named it if need be.
        what: What it should be, for the message.

    Raises:
        InputError: Something fails.
    """
    try:
        yield
    except InputError:
        raise
    except MemoryError:
        raise InputError(f"{path} needs more memory than is allowed; give a smaller or a sound file") from None
    except FileNotFoundError:
        raise InputError(f"{path} does not exist; it should be the {what}") from None
    except Exception as error:
        if is_own_fault(error):
            raise
        told = f"{error} is missing" if isinstance(error, KeyError) else f"{type(error).__name__}: {error}"
        raise InputError(f"{path}: broken, or no {what}: {' '.join(told.split())[:200]}; mend it") from error


@contextmanager
def unpacked(path: Path) -> Iterator[BinaryIO]:
    """Open a file that may be packed by gzip, whatever its name, for reading its content.

    Raises:
        InputError: On reading: it is no whole gzip file.
        OSError: It can't be opened.
    """
    with path.open("rb") as plain:
        packed = plain.read(len(GZIP)) == GZIP
        plain.seek(0)
        if not packed:
            yield plain
            return
        try:
            with gzip.open(plain) as content:
                yield cast("BinaryIO", content)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise InputError(f"{path}: broken or truncated gzip: {error}") from None
