"""Keeps this process's standard streams, and how deep calls may go, while external code or a library runs.

What others named goes to them without control characters, which would steer the terminal.
"""

import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from fcntl import F_DUPFD_CLOEXEC, fcntl
from resource import RLIMIT_NOFILE, getrlimit
from typing import TextIO

LEAST_COPY = min(4096, getrlimit(RLIMIT_NOFILE)[0]) // 2
"""Copies of streams have descriptors from here on, so that code that closes the first few hundred leaves them open."""

HERE = "/proc/self/cwd"
"""A link to the working folder, which may be read where that was deleted."""
CONTROL = re.compile(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]")
"""Control characters but tabs and ends of lines."""


def without_controls(text: str) -> str:
    """Return a text with a question mark for each control character."""
    return CONTROL.sub("?", text)


def to_stderr(line: str) -> None:
    """Write a line, in which may be what others named, to stderr if there is one."""
    if sys.stderr is not None:
        sys.stderr.write(f"{without_controls(line)}\n")


def open_missing_streams() -> None:
    """Open as nowhere what is closed of stdin, stdout and stderr, as some schedulers start programs."""
    while (number := os.open(os.devnull, os.O_RDWR)) <= 2:
        os.set_inheritable(number, True)
    os.close(number)
    sys.stdout, sys.stderr = sys.stdout or _text_of(1), sys.stderr or _text_of(2)


@contextmanager
def streams_and_depth_kept() -> Iterator[None]:
    """Put stdout, stderr, the working folder, and how deep calls may go, back as they were, whatever the block does.

    What it writes on stdout goes to stderr, since stdout may hold a result as JSON. The block may lead the descriptors
    elsewhere: what was written before is flushed, and what it writes in it too.
    """
    kept = [
        (number, name, getattr(sys, name), fcntl(number, F_DUPFD_CLOEXEC, LEAST_COPY))
        for number, name in ((1, "stdout"), (2, "stderr"))
    ]
    for _, _, stream, _ in kept:
        flush(stream)
    deepest, here = sys.getrecursionlimit(), os.readlink(HERE)
    os.dup2(2, 1)
    try:
        yield
    finally:
        sys.setrecursionlimit(max(deepest, sys.getrecursionlimit()))
        with suppress(OSError):  # it was deleted
            os.chdir(here)
        for number, name, stream, copy in kept:
            flush(stream)
            with suppress(OSError):  # the copy was closed
                os.dup2(copy, number)
                os.close(copy)
            setattr(sys, name, _text_of(number) if getattr(stream, "closed", False) else stream)


def _text_of(number: int) -> TextIO:
    return open(number, "w", encoding="utf-8", closefd=False)


def flush(stream: TextIO | None) -> None:
    """Write what a stream holds back, where that is possible."""
    with suppress(AttributeError, OSError, ValueError):  # there is none, its reader is gone, or it is closed
        stream.flush()  # type: ignore[union-attr]
