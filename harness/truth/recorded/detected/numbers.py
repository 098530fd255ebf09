"""Reads external text files of numbers within limits."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.common.bounds import Numbers, check_numbers
from harness.common.errors import InputError
from harness.common.untrusted_files import check_file, number
from harness.truth.recorded.detected.recorded_drive import Labels
from harness.truth.recorded.order import TOLERATED_SHARE, leaps
from mmpf.numerics.arrays import FloatArray

FRAME, MOMENTS = Numbers(0, 100_000, whole=True), Numbers(1, 100_000)
SIZE_M, PLACE_M = Numbers(0.05, 60.0), Numbers(-1e5, 1e5)
"""Of a box, as seen from the car."""
WAY = {"a pose": Numbers(-1e8, 1e8), "the way to the next pose": Numbers(0.0, 25.0)}
"""Of a car, metres; the latter in a tenth of a second, or of one or two that are missing."""
BOX = {"the frame": FRAME, "the size": SIZE_M, "the place": PLACE_M}


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
    leap_m = np.hypot.reduce(np.diff(place, axis=0), axis=1)
    check_numbers(path, {"a pose": place, "the way to the next pose": leap_m}, WAY, lambda row: f"pose {row}")


def check_moves(path: Path, labels: Labels) -> None:
    """Refuse labels of which more than a few leap from one step to a later one, in the plane.

    Raises:
        InputError: They do.
    """
    far = leaps(labels.step / 10.0, labels.thing, labels.x_m, labels.y_m)
    if far.mean() > TOLERATED_SHARE:
        raise InputError(f"{path}: a thing leaps before frame {labels.step[far][0]}, and others do; fix the places")


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
    columns = {"the frame": step, "the size": size, "the place": place}
    check_numbers(path, columns, BOX, lambda row: f"box {row + 1}")
