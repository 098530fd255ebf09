"""A disk that is full from one write on, for whatever is written whole under another name and renamed."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


@contextmanager
def disk_full_from(write: int) -> Iterator[list[str]]:
    """Refuse a write, counted from one, and all after it; yield the names of the files that were written."""
    written: list[str] = []

    def until_full(path: Path, final: Path) -> Path:
        if len(written) + 1 >= write:
            raise OSError(errno.ENOSPC, "No space left on device", str(final))
        written.append(final.name)
        os.replace(path, final)
        return final

    with pytest.MonkeyPatch.context() as full:
        full.setattr(Path, "replace", until_full)
        yield written


def moments(writes: int, often: int = 3) -> list[object]:
    """Return every write but the first, without which nothing begins; most are tried by the slow tests alone."""
    return [pytest.param(write, marks=() if write % often == 1 else pytest.mark.slow) for write in range(2, writes + 1)]
