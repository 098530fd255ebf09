"""Parses lists of values on the command line: ``5:65:10``, ``5,20,45``, ``10`` seeds or seeds ``0:10``."""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from decimal import Decimal, InvalidOperation

from harness.common.errors import InputError

MOST_VALUES = 100_000
MOST_SEED = 2**31 - 1


@contextmanager
def _told(parameter: str, text: str, example: str) -> Iterator[None]:
    """Turn what is wrong with a list into an error that names the parameter and gives an example."""
    try:
        yield
    except ValueError as error:
        raise InputError(f"`{parameter}` {text}: {error}; for example `{parameter}` {example}") from None


def numbers(text: str, parameter: str, example: str) -> tuple[float, ...]:
    """Return the numbers of ``START:STOP:STEP`` (both ends included) or of a list with commas.

    Raises:
        InputError: It is no such text, holds no number, one twice, or too many; the message names the parameter.
    """
    with _told(parameter, text, example):
        values = _steps(text) if ":" in text else [_number(word) for word in text.split(",")]
        if len(set(values)) < len(values):
            raise ValueError("a value stands there twice")
    return tuple(float(value) for value in values)


def names(text: str, parameter: str, example: str) -> tuple[str, ...]:
    """Return the names of a list with commas; those in square brackets belong to a name."""
    words = [word.strip() for word in re.split(r",(?![^\[]*\])", text)]
    with _told(parameter, text, example):
        if not all(words) or len(set(words)) < len(words):
            raise ValueError("a name stands there twice" if all(words) else "an empty name")
    return tuple(words)


def seed_values(text: str) -> range:
    """Return the seeds of a number of them, from 0, or of a range ``A:B``, B excluded."""
    first, end = text.split(":", 1) if ":" in text else ("0", text)
    with _told("seeds", text, "10"):
        if not (first.isdecimal() and end.isdecimal() and int(first) < int(end) <= MOST_SEED):
            raise ValueError("give a number of seeds or a range A:B with A below B")
        if (count := int(end) - int(first)) > MOST_VALUES:
            raise ValueError(f"{count} values, at most {MOST_VALUES} are allowed")
    return range(int(first), int(end))


def _steps(text: str) -> list[Decimal]:
    words = text.split(":")
    if len(words) != 3:
        raise ValueError("a range is START:STOP:STEP")
    start, stop, step = map(_number, words)
    if step <= 0 or stop < start:
        raise ValueError("START must not lie above STOP, STEP must be above 0")
    if (count := math.floor((stop - start) / step) + 1) > MOST_VALUES:
        raise ValueError(f"{count} values, at most {MOST_VALUES} are allowed")
    return [start + k * step for k in range(count)]


def _number(word: str) -> Decimal:
    # Decimal steps give 0.3 where adding 0.1 up in binary does not.
    try:
        value = Decimal(word.strip())
    except InvalidOperation:
        value = Decimal("nan")
    if not value.is_finite():
        raise ValueError(f"{word.strip()!r} is not a number" if word.strip() else "a number is missing")
    return value
