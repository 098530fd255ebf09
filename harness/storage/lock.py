"""A lock on a folder; the system releases it however the process ends."""

import errno
import fcntl
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from harness.common.errors import InputError

LOCK = ".mmpf-harness-lock"
# A file system that knows no locks; the runs on it go without.
NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP, errno.ENOSYS, errno.EINVAL)


@dataclass(frozen=True)
class FolderLock:
    """A lock on a file, held until released or the process ends; one left by a killed process locks nobody out."""

    path: Path
    _file: IO[bytes]

    def release(self) -> None:
        """Give the lock back; may be called again."""
        if not self._file.closed:
            # Before the lock goes: whoever comes next makes a file of its own.
            self.path.unlink(missing_ok=True)
            self._file.close()


def lock_beside(folder: Path) -> FolderLock:
    """Take the lock of a folder that is not there yet or will be replaced; the file lies beside it."""
    return _take(folder.with_name(f".{folder.name}{LOCK}"), folder)


def lock_within(folder: Path) -> FolderLock:
    """Take the lock of a folder that is there and stays; the file lies in it."""
    return _take(folder / LOCK, folder)


def remove_stale_locks(parent: Path) -> None:
    """Remove the files of locks beside folders whose holders were killed."""
    for path in parent.glob(f".*{LOCK}"):
        with suppress(InputError, OSError):
            _take(path, path).release()


def _take(path: Path, folder: Path) -> FolderLock:
    """Take a lock, or raise an ``InputError`` where another process, or another run in this one, holds it."""
    while True:
        # Nobody's file is written through a link, and a pipe of that name keeps nobody waiting.
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK, 0o666)
        file = os.fdopen(handle, "r+b", buffering=0)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno in NO_LOCKS:
                return FolderLock(path, file)
            file.close()
            if error.errno not in (errno.EWOULDBLOCK, errno.EACCES):
                raise
            raise InputError(
                f"`out`: another process is writing {folder}; wait until it ends or choose another folder"
            ) from None
        if _is_still(path, file):
            return FolderLock(path, file)
        file.close()


def _is_still(path: Path, file: IO[bytes]) -> bool:
    """Return whether the locked file still has its name: its last holder may just have removed it."""
    try:
        return os.path.samestat(path.stat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False
