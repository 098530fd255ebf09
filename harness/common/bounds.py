"""Declares what the numbers of a file may be; one checker refuses in one line those that are not so."""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from harness.common.errors import InputError

NONE = np.zeros(0, dtype=np.bool_)
LEAP_MPS, LEAP_M = 80.0, 1.0
"""Between two rows, no vehicle moves farther than this speed allows, and a distance for rounding."""
MOST_ODD = 0.004
"""Share of rows that may break a rule by a slip of the recording; the recording car's may not."""
ASIDE_MPS, EGO_ASIDE_MPS, BACK_MPS, ROUGH_M = 10.0, 3.0, 8.0, 0.5
"""Above these speeds no vehicle, and no recording car, moves more sideways than ahead, and no recording car reverses;
the distance is that of rounding."""
TURN_RAD, TURN_S = math.radians(35.0), 0.2
"""No vehicle turns by more within this time."""
TWICE = "is there twice"


@dataclass(frozen=True)
class Numbers:
    """What the numbers of one column or attribute may be; finite in any case.

    Attributes:
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
            of: What a row is called, from its number if they differ.

        Raises:
            ValueError: One is not allowed; the message is one sentence that names its row.
        """
        few = values if isinstance(values, list) else [values]
        plain = all(type(each) is float and math.isfinite(each) and self.least <= each <= self.most for each in few)
        if plain and not (self.whole or self.rising):
            return  # by far the most common, in files of networks
        found = np.asarray(values)
        if found.size and found.dtype.kind not in "iuf":
            odd = next((each for each in found.ravel().tolist() if not _is_number(each)), "texts")
            raise ValueError(f"{name} holds {repr(odd)[:40]}, not numbers")
        rows = found.reshape(len(found) if found.ndim else 1, -1).astype(np.float64) if found.size else np.zeros((0, 1))
        before = np.vstack([np.full((1, rows.shape[1]), -math.inf), rows[:-1]]) if self.rising else rows
        faults = {
            "is missing or not finite": ~np.isfinite(rows) & ~(self.gaps & np.isnan(rows)),
            "is {value:g}, not a whole number": self.whole & np.isfinite(rows) & (rows != np.round(rows)),
            f"is {{value:g}}, not from {self.least:g} to {self.most:g}": (rows < self.least) | (rows > self.most),
            "goes back from {before:g} to {value:g}; put the rows in order": ~(rows > before) if self.rising else NONE,
        }
        for told, wrong in faults.items():
            if wrong.any():
                place = divmod(int(wrong.argmax()), rows.shape[1])
                row = of if isinstance(of, str) else of(place[0])
                raise ValueError(f"{name}{row and f' of {row}'} {told.format(value=rows[place], before=before[place])}")


PLACE_M, TURNED_RAD = Numbers(-1e7, 1e7), Numbers(-2.5 * math.pi, 2.5 * math.pi)
"""Where something is in the plane, and where it points: a turn either way from wherever it is counted."""
SPEED_MPS, ACCEL_MPS2 = Numbers(-120.0, 120.0, gaps=True), Numbers(-1e3, 1e3, gaps=True)
UNIT = Numbers(0.99, 1.01)
"""The square of a rotation's length."""
OF_THINGS = dict.fromkeys(("lon_m", "lat_m", "x_m", "y_m"), PLACE_M) | {
    "time_s": Numbers(),
    "heading_rad": replace(TURNED_RAD, gaps=True),
    "speed_mps": SPEED_MPS,
    "lat_speed_mps": SPEED_MPS,
    "accel_mps2": ACCEL_MPS2,
    "length_m": Numbers(0.05, 60.0, gaps=True),
    "width_m": Numbers(0.05, 10.0, gaps=True),
}
"""What a row of anything on a road may hold, by the column's name."""


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
        allowed: What those of each column may be; a column that is not there is not looked at.
        of: What a row is called, from its number if they differ.

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
    """Refuse a table that lacks columns, or has them twice, of which pandas calls the second ``NAME.1``."""
    names = list(map(str, there))
    if missing := [name for name in needed if name not in names]:
        raise InputError(f"{place}: it has no column {', '.join(missing)}, but {', '.join(names)[:200]}: {fix}")
    if twice := [name for name in needed if names.count(name) > 1 or f"{name}.1" in names]:
        raise InputError(f"{place}: the column {twice[0]} {TWICE}: remove one")


def check_moves(
    place: object,
    who: npt.NDArray[Any],
    time_s: npt.NDArray[np.float64],
    x_m: npt.NDArray[np.float64],
    y_m: npt.NDArray[np.float64],
    heading_rad: npt.NDArray[np.float64],
    is_ego: bool = False,
) -> None:
    """Refuse paths in the plane that no vehicle drives.

    Arrays are of shape (n,), in any order of time; ``who`` says in any sortable way whose row each is, and a direction
    that is not told is nan. Of the recording car no row may be odd; of others a few may.

    Args:
        place: The file, or the option and the file.

    Raises:
        InputError: One is at two places at once, leaps, moves sideways or backwards, or turns at once.
    """
    order = np.lexsort((time_s, who))
    step_s, moved_x, moved_y, turned = (np.diff(each[order]) for each in (time_s, x_m, y_m, heading_rad))
    same, far_m, direction = who[order][1:] == who[order][:-1], np.hypot(moved_x, moved_y), heading_rad[order][:-1]
    ahead_m = moved_x * np.cos(direction) + moved_y * np.sin(direction)
    aside = np.abs(moved_y * np.cos(direction) - moved_x * np.sin(direction)) > np.abs(ahead_m)
    fastest_aside_mps = EGO_ASIDE_MPS if is_ego else ASIDE_MPS
    kinds = {
        TWICE: step_s == 0.0,
        "leaps": far_m > LEAP_MPS * step_s + LEAP_M,
        "moves sideways": aside & (far_m > fastest_aside_mps * step_s + ROUGH_M) & (step_s <= 1.0),
        "turns at once": (np.abs(np.sin(turned)) > math.sin(TURN_RAD)) & (step_s <= TURN_S),
        "moves backwards": is_ego & (ahead_m < -BACK_MPS * step_s - ROUGH_M),
    }
    for told, odd in kinds.items():
        rows = order[1:][odd & same]
        if len(rows) > (0 if is_ego or told == TWICE else MOST_ODD * len(who)):
            moment = f"{str(who[rows[0]])[:60]} {told} at {time_s[rows[0]]:g} s"
            raise InputError(f"{place}: {moment}; mend its places, times or directions")
