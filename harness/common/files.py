"""Writes files of results atomically: numbers for programs, tables for people, settings as TOML."""

import errno
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import tomli_w

from harness.common.error_text import in_words
from harness.common.errors import InputError, RunError

NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EIO, errno.ENOMEM)
"""What the system refuses through no fault of the command."""
TEMPORARY = ".partial"
_TEMPORARY_NAME = re.compile(rf"\..+\.[0-9]+{re.escape(TEMPORARY)}")


@contextmanager
def replacing(final: Path) -> Iterator[Path]:
    """Yield a temporary path in a file's folder; it replaces the file if the block succeeds, and is deleted otherwise.

    What is there but is no file, such as ``/dev/stdout``, is yielded itself; a link is followed to what is there.
    """
    if final.is_symlink() and not final.exists():
        raise InputError(f"{final} is a link that leads to nothing; remove it")
    final = Path(os.path.realpath(final))
    if final.is_fifo():
        raise InputError(f"{final} is a pipe, which may never be read; give a file")
    if final.exists() and not final.is_file():
        yield final
        return
    temporary = temporary_of(final)
    if temporary.is_symlink():
        raise InputError(f"{temporary} is a link, and should be a file that this program writes; remove it")
    try:
        yield temporary
        temporary.replace(final)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


@contextmanager
def writing(parameter: str, path: Path) -> Iterator[None]:
    """Turn what the system refuses in the block into an error on one line.

    Raises:
        RunError: There is no room, through no fault of the input.
        InputError: It may not be written there.
    """
    try:
        yield
    except OSError as error:
        why = os.strerror(error.errno) if error.errno else in_words(error)
        told = f"`{parameter}`: can't write {path}: {why}; choose another place, or make room"
        raise (RunError if error.errno in NO_ROOM else InputError)(told) from None


def check_folder(path: Path, parameter: str) -> None:
    """Refuse a place where no folder can be, before the work whose results go there."""
    there = next(each for each in (path, *path.absolute().parents) if each.exists())
    if not (there.is_dir() and os.access(there, os.W_OK)):
        raise InputError(f"`{parameter}`: no folder can be written at {path}; choose another place")


def check_unlinked(folder: Path, paths: Iterable[Path], parameter: str) -> None:
    """Refuse places in a folder to which a link leads: who made the folder would choose what is written over.

    Raises:
        InputError: There is a link on the way from the folder to one of them.
    """
    for part in (part for path in paths for part in (path, *path.parents) if folder in part.parents):
        if part.is_symlink():
            raise InputError(f"`{parameter}`: {part} is a link, through which nothing is written; remove it")


def full_disk(error: BaseException | None) -> OSError | None:
    """Return the system's refusal for want of room on a disk that an error is, or that led to it; None if none did."""
    while error is not None and not (isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)):
        error = error.__cause__ or error.__context__
    return None if error is None else OSError(error.errno, error.strerror)


def temporary_of(final: Path) -> Path:
    """Return where ``replacing`` lets a file be written first."""
    return final.with_name(f".{final.name}.{os.getpid()}{TEMPORARY}")


def is_temporary(name: str) -> bool:
    """Return whether a file's name is one that ``replacing`` gives out, left by a process that was killed."""
    return _TEMPORARY_NAME.fullmatch(name) is not None


def write_text(path: Path, text: str) -> None:
    """Write a text so that the file is there whole or as it was."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def write_results(folder: Path, numbers: Mapping[str, Any], text: str) -> None:
    """Write ``results.json`` and ``results.md`` into a folder, which is made if missing."""
    folder.mkdir(parents=True, exist_ok=True)
    write_text(folder / "results.json", json.dumps(numbers, indent=1) + "\n")
    write_text(folder / "results.md", text)


def write_toml(path: Path, table: Mapping[str, Any], comment: str) -> None:
    """Write a table as TOML below a comment, whose lines are given without their ``#``."""
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    write_text(path, f"{head}\n{tomli_w.dumps(table)}")


def save_figure(figure: Any, path: Path, **options: Any) -> None:  # noqa: ANN401
    """Save a matplotlib figure so that the file is there whole or as it was; its ending names the format.

    The figure has no stated type, since matplotlib is imported only where something is drawn.
    """
    with replacing(path) as temporary:
        figure.savefig(temporary, format=path.suffix.removeprefix("."), **options)
