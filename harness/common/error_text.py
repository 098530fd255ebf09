"""Turns pydantic's errors, and exceptions of external code, into sentences."""

from __future__ import annotations

import difflib
import os
import sysconfig
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import FrameType, ModuleType
from typing import TYPE_CHECKING, NamedTuple

from harness.common.errors import InputError, RunError

if TYPE_CHECKING:  # `--help` answers sooner without pydantic
    from pydantic import ValidationError

MOST_NAMED = 8
PACKAGES = {"harness", "mmpf"}
INSTALLED = tuple(sysconfig.get_path(kind) for kind in ("stdlib", "purelib", "platlib"))


def nearest(key: str, known: Sequence[str], listed: str = "`python -m harness settings` lists them") -> str:
    """Return what may have been meant by a key that there is none of, or some of those that there are."""
    leaf = key.rsplit(".", 1)[-1]
    leaves = {name.rsplit(".", 1)[-1]: name for name in reversed(known)}
    near = [name for name in known if name.rsplit(".", 1)[-1] == leaf]
    near = near or difflib.get_close_matches(key, known, n=3, cutoff=0.5)
    near = near or [leaves[name] for name in difflib.get_close_matches(leaf, leaves, n=3, cutoff=0.5)]
    if near:
        return f"; did you mean {' or '.join(near[:3])}?"
    more = f" and {len(known) - MOST_NAMED} more" if len(known) > MOST_NAMED else ""
    return f"; known are {', '.join(known[:MOST_NAMED])}{more}; {listed}"


class Problem(NamedTuple):
    """The first thing that is wrong with a table of settings: its dotted key, in words, and what stands there."""

    key: str
    message: str
    given: object
    unknown: bool


def first_problem(error: ValidationError) -> Problem:
    """Return the first of the problems that pydantic found."""
    problem = error.errors(include_url=False)[0]
    message = problem["msg"].removeprefix("Value error, ")
    return Problem(
        key=".".join(str(part) for part in problem["loc"]),
        message=message[:1].lower() + message[1:],
        given=problem["input"],
        unknown=problem["type"] == "extra_forbidden",
    )


def shown(value: object, most: int = 60) -> str:
    """Return a value as Python writes it, cut off, on one line; its class where its own text fails."""
    try:
        text = " ".join(repr(value).split())
    except Exception:
        text = f"<{type(value).__name__}>"
    return text if len(text) <= most else f"{text[:most]}..."


def what_it_raised(error: BaseException) -> str:
    """Return an exception of external code on one line: its text, and the line of the user's code that it came from.

    Where no such line is found, the line that raised it.
    """
    frames = list(traceback.walk_tb(error.__traceback__))
    users = [(frame, line) for frame, line in frames if _is_users(frame)]
    innermost = (users or frames)[-1:]
    place = "".join(f", {Path(frame.f_code.co_filename).name} line {line}" for frame, line in innermost)
    text = "it has no text"
    with suppress(Exception):
        text = str(error)
    return " ".join(f"{type(error).__name__}: {text}{place}".split())


def _is_users(frame: FrameType) -> bool:
    """Return whether a frame is neither of this program nor of an installed or standard module."""
    file, package = frame.f_code.co_filename, frame.f_globals.get("__name__", "").partition(".")[0]
    return Path(file).is_absolute() and package not in PACKAGES and not file.startswith(INSTALLED)


def is_own_fault(error: BaseException) -> bool:
    """Return whether an exception is a fault of this program's code: no content of a file raises such a one there."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    if frame.f_globals.get("__name__", "").partition(".")[0] not in PACKAGES:
        return False
    if isinstance(error, AttributeError):
        kind = error.obj if isinstance(error.obj, type | ModuleType) else type(error.obj)
        return getattr(kind, "__module__", kind.__name__).partition(".")[0] in PACKAGES
    return isinstance(error, NameError | ImportError | AssertionError | NotImplementedError)


@contextmanager
def drawing(parameter: str) -> Iterator[None]:
    """Turn what matplotlib raises in the block, over the user's settings of it for example, into one line.

    Raises:
        InputError: It raised something; the message names the parameter that asks for the picture.
    """
    try:
        yield
    except (InputError, RunError, OSError, MemoryError):
        raise
    except Exception as error:
        if is_own_fault(error):
            raise
        told = f"it can't be drawn ({what_it_raised(error)}); see MPLBACKEND and matplotlibrc"
        raise InputError(f"`{parameter}`: {told}") from error


def in_words(error: BaseException) -> str:
    """Return what ended a run on one line, such as what the system refused: a full disk, a long name."""
    if isinstance(error, OSError) and error.errno:
        return f"{str(error.filename)[:200]}: " * bool(error.filename) + os.strerror(error.errno)
    return str(error) if isinstance(error, RunError) else what_it_raised(error)
