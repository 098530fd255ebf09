"""Elementary functions of arrays whose bytes are equal on all processors of one level.

NumPy chooses among several versions of each by the processor, and they differ in the last digit, which a filter lets
grow. The loops are imported when first called, so that a road or a scan needs no compiler.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

import numpy as np

# Arguments and results are as NumPy's.
# ruff: noqa: ANN401


@cache
def _loops() -> Any:
    return import_module("mmpf.numerics.elementary_loops")


def exp(x: Any, out: Any = None) -> Any:
    """Return e to the power of x like NumPy, to 3e-16 of it; 0 below -708 and infinity above 709."""
    return _of_all(_loops().exp, x, out)


def log(x: Any, out: Any = None) -> Any:
    """Return natural logarithms like NumPy, without its warnings of what has none."""
    return _of_all(_loops().log, x, out)


def _of_all(loop: Any, x: Any, out: Any) -> Any:
    values = np.asarray(x)
    values = values if values.dtype == np.float32 else values.astype(np.float64, copy=False)
    if out is None:
        out = np.empty(values.shape, values.dtype)
    loop(np.ascontiguousarray(values).reshape(-1), out.reshape(-1, copy=False))
    return out if out.ndim else out[()]


def expm1(x: Any) -> Any:
    """Return exp(x) - 1."""
    return _loops().expm1(x)


def cos(x: Any) -> Any:
    """Return the cosine."""
    return _loops().cos(x)


def sin(x: Any) -> Any:
    """Return the sine."""
    return _loops().sin(x)


def arctan(x: Any) -> Any:
    """Return the angle, radians, that has this tangent."""
    return _loops().arctan(x)


def arctan2(y: Any, x: Any) -> Any:
    """Return the direction of (x, y), radians."""
    return _loops().arctan2(y, x)


def power(x: Any, exponent: Any) -> Any:
    """Return x to the power of an exponent."""
    return _loops().power(x, exponent)
