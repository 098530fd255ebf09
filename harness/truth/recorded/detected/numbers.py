"""Reads external text files of numbers within limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.common.errors import InputError
from harness.common.untrusted_files import check_file, number
from mmpf.numerics.arrays import FloatArray

MOST_STEPS = 100_000
FARTHEST_M, FARTHEST_OF_ALL_M = 1e5, 1e8
# In a tenth of a second, or of one or two that are missing.
FARTHEST_STEP_M = 25.0
SIZES_M = (0.05, 60.0)


def words_of(path: Path, separator: str | None, least: int, what: str) -> list[list[str]]:
    """Return the words of each line that is not blank.

    Args:
        separator: What stands between words; None for blanks.
        least: Words that a line has at least.
        what: What a line is of, for the message.

    Raises:
        InputError: The file is missing or no text, or a line has fewer words.
    """
    check_file(path)
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        raise InputError(f"{path} is missing; it has the {what}") from None
    except OSError as error:
        raise InputError(f"{path}: can't be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is no text; it should have the {what}") from None
    rows = [(place, line.split(separator)) for place, line in enumerate(lines, start=1) if line.strip()]
    for place, row in rows:
        if len(row) < least:
            raise InputError(f"{path}, line {place}: {len(row)} values, {what} has {least}")
    return [row for _, row in rows]


def numbers_of(path: Path, rows: list[list[str]], first: int, last: int) -> FloatArray:
    """Return columns of all rows as numbers, shape (n, last - first).

    Raises:
        InputError: One is no finite number.
    """
    try:
        values = np.array([[number(word) for word in row[first:last]] for row in rows], dtype=np.float64)
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    return values.reshape(-1, last - first)


def check_way(path: Path, place: FloatArray) -> None:
    """Refuse the way of a car, places of shape (n, 3) a tenth of a second apart, that no car drives.

    Raises:
        InputError: It lies too far away, or leaps.
    """
    if not (np.abs(place) <= FARTHEST_OF_ALL_M).all():
        raise InputError(f"{path}: a pose is farther away than {FARTHEST_OF_ALL_M:g} m")
    leap_m = np.hypot.reduce(np.diff(place, axis=0), axis=1)
    if (leap_m > FARTHEST_STEP_M).any():
        step = int(leap_m.argmax())
        raise InputError(f"{path}: from pose {step} to the next it is {leap_m[step]:.0f} m; a car drives less")


def check_boxes(path: Path, step: FloatArray, size: FloatArray, place: FloatArray) -> None:
    """Refuse boxes that nothing on a road has.

    Args:
        path: The file, for the message.
        step: Their steps, shape (n,).
        size: Their extents, metres, shape (n, k).
        place: Their places, metres, shape (n, k).

    Raises:
        InputError: A step is none of a drive, a size that of no vehicle, or a place too far away.
    """
    if not len(step):
        return
    if (step != np.round(step)).any() or step.min() < 0 or step.max() >= MOST_STEPS:
        raise InputError(f"{path}: a frame is not a whole number of 0 to {MOST_STEPS - 1}")
    if size.min() < SIZES_M[0] or size.max() > SIZES_M[1]:
        raise InputError(f"{path}: the size of a box is not within {SIZES_M[0]:g} to {SIZES_M[1]:g} m")
    if np.abs(place).max() > FARTHEST_M:
        raise InputError(f"{path}: a box is farther away than {FARTHEST_M:g} m")
