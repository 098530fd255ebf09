"""The compiled loops of ``elementary``: polynomials that the compiler turns into vector instructions."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from mmpf.numerics.kernels import kernel, of_each

FloatArray = npt.NDArray[np.float64]
_BLOCK = 256
_LOG2_E, _LN2_HIGH, _LN2_LOW = 1.0 / math.log(2.0), 6.93147180369123816490e-01, 1.90821492927058770002e-10
# Added to a number, this leaves its nearest integer in the last bits.
_ROUND = 1.5 * 2.0**52
_ROOT_HALF_BITS = np.int64(0x3FE6A09E667F3BCD)
_LOWEST, _HIGHEST, _LEAST_NORMAL = -708.0, 709.0, 2.0**-1022
_TAYLOR = tuple(1.0 / math.factorial(n) for n in range(13, -1, -1))
_ATANH = tuple(2.0 / n for n in range(21, 2, -2))


@of_each()
def expm1(x: float) -> float:
    """Return exp(x) - 1."""
    return math.expm1(x)


@of_each()
def cos(x: float) -> float:
    """Return the cosine."""
    return math.cos(x)


@of_each()
def sin(x: float) -> float:
    """Return the sine."""
    return math.sin(x)


@of_each()
def arctan2(y: float, x: float) -> float:
    """Return the direction of (x, y), radians."""
    return math.atan2(y, x)


@of_each()
def arctan(x: float) -> float:
    """Return the angle, radians, that has this tangent."""
    return math.atan(x)


@of_each()
def power(x: float, exponent: float) -> float:
    """Return x to the power of an exponent."""
    return math.pow(x, exponent)


@kernel()
def exp(x: FloatArray, out: FloatArray) -> None:
    """Write e to the power of x, shape (n,); ``out`` may be ``x``."""
    bits, rest = np.empty(_BLOCK, np.int64), np.empty(_BLOCK)
    scale = bits.view(np.float64)
    for first in range(0, len(x), _BLOCK):
        size = min(_BLOCK, len(x) - first)
        own, written = x[first : first + size], out[first : first + size]
        for n in range(size):
            value = min(max(np.float64(own[n]), _LOWEST), _HIGHEST)
            rounded = value * _LOG2_E + _ROUND
            scale[n] = rounded
            whole = rounded - _ROUND
            rest[n] = (value - whole * _LN2_HIGH) - whole * _LN2_LOW
        for n in range(size):
            bits[n] = (bits[n] + 1023) << 52
        for n in range(size):
            series = _TAYLOR[0]
            for coefficient in _TAYLOR[1:]:
                series = series * rest[n] + coefficient
            value = np.float64(own[n])
            result = series * scale[n]
            result = 0.0 if value < _LOWEST else result
            result = np.inf if value > _HIGHEST else result
            written[n] = result if value == value else value  # noqa: PLR0124


@kernel()
def log(x: FloatArray, out: FloatArray) -> None:
    """Write natural logarithms, shape (n,); ``out`` may be ``x``."""
    bits, power = np.empty(_BLOCK, np.int64), np.empty(_BLOCK)
    mantissa = bits.view(np.float64)
    for first in range(0, len(x), _BLOCK):
        size = min(_BLOCK, len(x) - first)
        own, written = x[first : first + size], out[first : first + size]
        for n in range(size):
            value = np.float64(own[n])
            mantissa[n] = value if value >= _LEAST_NORMAL else value * 2.0**54
        for n in range(size):
            exponent = (bits[n] - _ROOT_HALF_BITS) >> 52
            bits[n] -= exponent << 52
            power[n] = np.float64(np.int32(exponent))
        for n in range(size):
            value = np.float64(own[n])
            whole = power[n] if value >= _LEAST_NORMAL else power[n] - 54.0
            share = (mantissa[n] - 1.0) / (mantissa[n] + 1.0)
            square = share * share
            series = _ATANH[0]
            for coefficient in _ATANH[1:]:
                series = series * square + coefficient
            result = whole * _LN2_HIGH + (whole * _LN2_LOW + (series * square * share + 2.0 * share))
            result = result if value < np.inf else np.inf
            result = result if value != 0.0 else -np.inf
            written[n] = result if value >= 0.0 else np.nan
