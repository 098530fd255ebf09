"""Declares what the numbers of a file may be; one checker refuses in one line those that are not so."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from harness.common.errors import InputError

NONE = np.zeros(0, dtype=np.bool_)


@dataclass(frozen=True)
class Numbers:
    """What the numbers of one column or attribute may be; finite in any case.

    Attributes:
        least: The smallest that is allowed.
        most: The largest that is allowed.
        whole: Whether they are whole numbers.
        rising: Whether each is above the one before it.
        gaps: Whether nan may stand for one that is not told.
    """

    least: float = -math.inf
    most: float = math.inf
    whole: bool = False
    rising: bool = False
    gaps: bool = False

    def check(self, name: str, values: npt.ArrayLike, of: Callable[[int], str] | str = "") -> None:
        """Refuse numbers of any shape of which one is not allowed.

        Args:
            name: What they are, for the message.
            values: The numbers, in rows.
            of: What a row is called, from its number if they differ.

        Raises:
            ValueError: One is not allowed; the message is one sentence that names its row.
        """
        if type(values) is float and math.isfinite(values) and self.least <= values <= self.most and not self.whole:
            return  # by far the most common, in files of networks
        found = np.asarray(values)
        if found.dtype.kind not in "iuf":
            odd = next((each for each in found.ravel().tolist() if not _is_number(each)), "texts")
            raise ValueError(f"{name} holds {repr(odd)[:40]}, not numbers")
        rows = found.reshape(len(found) if found.ndim else 1, -1).astype(np.float64) if found.size else np.zeros((0, 1))
        before = np.vstack([np.full((1, rows.shape[1]), -math.inf), rows[:-1]]) if self.rising else rows
        faults = {
            "is missing or not finite": ~np.isfinite(rows) & ~(self.gaps & np.isnan(rows)),
            "is {value:g}, not a whole number": self.whole & np.isfinite(rows) & (rows != np.round(rows)),
            f"is {{value:g}}; {self.least:g} to {self.most:g} is believed": (rows < self.least) | (rows > self.most),
            "goes back from {before:g} to {value:g}; put the rows in order": ~(rows > before) if self.rising else NONE,
        }
        for told, wrong in faults.items():
            if wrong.any():
                place = divmod(int(wrong.argmax()), rows.shape[1])
                row = of if isinstance(of, str) else of(place[0])
                raise ValueError(f"{name}{row and f' of {row}'} {told.format(value=rows[place], before=before[place])}")


def _is_number(value: object) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number or (isinstance(value, str) and value.strip("+-.0123456789eE") == "")


def row_number(row: int) -> str:
    """Return what a row is called where nothing else names it."""
    return f"row {row + 1}"


def check_numbers(
    place: object,
    columns: Mapping[str, npt.ArrayLike] | pd.DataFrame,
    allowed: Mapping[str, Numbers],
    of: Callable[[int], str] | str = row_number,
    fix: str = "fix or remove it",
) -> None:
    """Refuse columns of numbers of which one is not as it is declared.

    Args:
        place: The file, or the option and the file.
        columns: The numbers by the column's name.
        allowed: What those of each column may be; a column that is not there is not looked at.
        of: What a row is called, from its number if they differ.
        fix: What the user may do about it.

    Raises:
        InputError: One is not; the message names file, column, row and fix.
    """
    for name, numbers in allowed.items():
        if name in columns:
            try:
                numbers.check(name, columns[name], of)
            except ValueError as error:
                raise InputError(f"{place}: {error}: {fix}") from None


def check_columns(place: object, there: Collection[str], needed: Collection[str], fix: str = "add it") -> None:
    """Refuse a table that lacks columns.

    Raises:
        InputError: It lacks one that is needed; the message names those that are missing.
    """
    if missing := [name for name in needed if name not in there]:
        has = ", ".join(map(str, there))[:200]
        raise InputError(f"{place}: the column {', '.join(missing)} is missing; it has {has}: {fix}")
