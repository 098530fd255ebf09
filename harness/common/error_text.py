"""What pydantic refuses, and what code from outside raises, in words."""

from __future__ import annotations

import traceback
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError


class Problem(NamedTuple):
    """The first thing that is wrong with a table of settings.

    Attributes:
        key: Where it is, keys joined by dots; empty for the table as a whole.
        message: What is wrong, beginning with a small letter.
        given: What stands there.
        unknown: Whether there is no such key.
    """

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


def what_it_raised(error: BaseException) -> str:
    """Return an error of somebody's code on one line: what it is, and the file and line that raised it."""
    frames = traceback.extract_tb(error.__traceback__)
    place = f", {Path(frames[-1].filename).name} line {frames[-1].lineno}" if frames else ""
    return " ".join(f"{type(error).__name__}: {error}{place}".split())
