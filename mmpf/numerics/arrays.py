"""Array types, and operations on every column of a struct of arrays."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

FloatArray = npt.NDArray[np.float64]
Float32Array = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]
Int32Array = npt.NDArray[np.int32]
BoolArray = npt.NDArray[np.bool_]
StringArray = npt.NDArray[np.str_]

Rows = TypeVar("Rows", bound="DataclassInstance")


def taken(rows: Rows, index: IntArray | BoolArray) -> Rows:
    """Return some rows of a struct of arrays: a frozen dataclass of arrays of shape (n, ...), such structs and None.

    Args:
        rows: The struct.
        index: Which rows, by number, shape (k,), or by a mask, shape (n,).
    """
    return _by_column(lambda column: column[index], rows)


def turned(x: FloatArray, y: FloatArray, turn_rad: FloatArray | float) -> tuple[FloatArray, FloatArray]:
    """Return differences in x and y as differences along and across a heading."""
    cosine, sine = np.cos(turn_rad), np.sin(turn_rad)
    return x * cosine + y * sine, y * cosine - x * sine


def wrapped(angle_rad: FloatArray) -> FloatArray:
    """Return angles in [-pi, pi), radians, in the argument's shape."""
    return np.asarray(np.remainder(angle_rad + np.pi, 2.0 * np.pi) - np.pi)


def joined(first: Rows, second: Rows) -> Rows:
    """Return the rows of one struct of arrays followed by those of another; see ``taken``."""
    return _by_column(lambda *columns: np.concatenate(columns), first, second)


def _by_column(change: Callable[..., Any], first: Rows, *others: Rows) -> Rows:
    changed = {}
    for name in (field.name for field in fields(first)):
        column = [getattr(rows, name) for rows in (first, *others)]
        if column[0] is not None:
            changed[name] = change(*column) if isinstance(column[0], np.ndarray) else _by_column(change, *column)
    return replace(first, **changed)
