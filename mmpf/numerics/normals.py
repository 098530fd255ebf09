"""Fast standard normal numbers: a third of the time of the generator's own method."""

from math import prod

import numpy as np
import numpy.typing as npt

from mmpf.numerics.arrays import Float32Array, Int32Array
from mmpf.numerics.kernels import kernel

QUARTER_PI = np.float32(0.25 * np.pi)


def standard_normals(rng: np.random.Generator, shape: tuple[int, ...]) -> Float32Array:
    """Draw independent standard normal numbers in single precision, none beyond 6.7.

    The method of Box and Muller (1958) on the generator's raw bits, with polynomials for logarithm, sine and cosine,
    which the compiler turns into vector instructions.

    Args:
        rng: Source of randomness.
        shape: Shape of the result.
    """
    size = prod(shape)
    pairs = (size + 1) // 2
    bits = rng.integers(0, 2**64, size=pairs, dtype=np.uint64).view(np.uint32)
    drawn = np.empty(2 * pairs, dtype=np.float32)
    first = drawn[:pairs]
    _box_muller(bits[:pairs], bits[pairs:], first, first.view(np.int32), drawn[pairs:])
    return drawn[:size].reshape(shape)


@kernel(fastmath=True)
def _box_muller(
    radius_bits: npt.NDArray[np.uint32],
    angle_bits: npt.NDArray[np.uint32],
    first: Float32Array,
    parts: Int32Array,
    second: Float32Array,
) -> None:
    """Write two normal numbers for each pair of random words (r^2 = -2 ln u); ``parts`` are the bits of ``first``."""
    for n in range(len(first)):
        first[n] = (np.float32(radius_bits[n]) + np.float32(1.0)) * np.float32(2.0**-32)
    for n in range(len(first)):
        # u = 2 ** exponent * mantissa, the mantissa between sqrt(1/2) and sqrt(2), whose logarithm is Cephes' series.
        exponent = (parts[n] - np.int32(0x3F3504F3)) >> np.int32(23)
        second[n] = np.float32(exponent) * np.float32(0.6931471805599453)
        parts[n] = parts[n] - (exponent << np.int32(23))
    for n in range(len(first)):
        t = first[n] - np.float32(1.0)
        series = np.float32(7.0376836292e-2)
        series = series * t + np.float32(-1.1514610310e-1)
        series = series * t + np.float32(1.1676998740e-1)
        series = series * t + np.float32(-1.2420140846e-1)
        series = series * t + np.float32(1.4249322787e-1)
        series = series * t + np.float32(-1.6668057665e-1)
        series = series * t + np.float32(2.0000714765e-1)
        series = series * t + np.float32(-2.4999993993e-1)
        series = series * t + np.float32(3.3333331174e-1)
        logarithm = t + t * t * (series * t - np.float32(0.5)) + second[n]
        radius = np.sqrt(max(np.float32(-2.0) * logarithm, np.float32(0.0)))
        # Two bits say the quadrant, the others the angle within it, between -pi/4 and pi/4.
        angle = np.float32(np.int32(angle_bits[n] << np.uint32(2))) * (QUARTER_PI * np.float32(2.0**-31))
        square = angle * angle
        sine = np.float32(-1.9515295891e-4) * square + np.float32(8.3321608736e-3)
        sine = (sine * square + np.float32(-1.6666654611e-1)) * square * angle + angle
        cosine = np.float32(2.443315711809948e-5) * square + np.float32(-1.388731625493765e-3)
        cosine = (cosine * square + np.float32(4.166664568298827e-2)) * square * square
        cosine += np.float32(1.0) - np.float32(0.5) * square
        along, across = (cosine, sine) if angle_bits[n] >> np.uint32(31) else (sine, cosine)
        sign = np.float32(1.0) - np.float32(2.0) * np.float32((angle_bits[n] >> np.uint32(30)) & np.uint32(1))
        first[n] = radius * sign * along
        second[n] = radius * sign * across
