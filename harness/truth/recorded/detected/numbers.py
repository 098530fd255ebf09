"""Reads external text files of numbers within limits."""

from pathlib import Path

import numpy as np

from harness.common.bounds import TURNED_RAD, Numbers
from harness.common.errors import InputError
from harness.common.untrusted_files import check_file, number, reading
from mmpf.numerics.arrays import FloatArray

FRAME, MOMENTS = Numbers(0, 100_000, whole=True), Numbers(1, 100_000)
BOX = {"the frame": FRAME, "the size": Numbers(0.05, 60.0), "the place": Numbers(-500.0, 500.0), "the turn": TURNED_RAD}
"""Of a box, as seen from the car."""


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
    with reading(path, f"text of {what}"):
        lines = path.read_text(encoding="utf-8").splitlines()
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
    with reading(path, "file of numbers"):
        values = np.array([[number(word) for word in row[first:last]] for row in rows], dtype=np.float64)
    return values.reshape(-1, last - first)
