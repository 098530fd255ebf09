"""What pydantic refuses, in words."""

from __future__ import annotations

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
