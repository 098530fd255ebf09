"""Sizes of tracked vehicles, estimated from detected boxes."""

from typing import TypeVar

import numpy as np

from mmpf.belief.mixture import Components
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.scan import BodySizes

Kept = TypeVar("Kept", bound=Components)


def with_measured_sizes(components: Kept, index: IntArray, sizes: BodySizes) -> Kept:
    """Return the components with a new measurement of some sizes: a scalar Kalman update each.

    Args:
        components: The components.
        index: Which of them were measured, each at most once, shape (k,).
        sizes: What was measured, shape (k,).
    """
    length, std_length = _updated(
        components.length_m, components.std_length_m, index, sizes.length_m, sizes.std_length_m
    )
    width, std_width = _updated(components.width_m, components.std_width_m, index, sizes.width_m, sizes.std_width_m)
    return components.having(length_m=length, std_length_m=std_length, width_m=width, std_width_m=std_width)


def sizes_of(components: Components, index: IntArray) -> BodySizes:
    """Return the known sizes of some components."""
    return BodySizes(
        components.length_m[index],
        components.width_m[index],
        components.std_length_m[index],
        components.std_width_m[index],
    )


def _updated(
    mean: FloatArray, std: FloatArray, index: IntArray, measured: FloatArray, measured_std: FloatArray
) -> tuple[FloatArray, FloatArray]:
    mean, std = mean.copy(), std.copy()
    variance = std[index] ** 2
    gain = variance / (variance + measured_std**2)
    mean[index] += gain * (measured - mean[index])
    std[index] = np.sqrt((1.0 - gain) * variance)
    return mean, std
