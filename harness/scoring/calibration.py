"""Are the trackers' standard deviations honest?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mmpf.compute.arrays import FloatArray

NORMAL_95 = 1.959963984540054
"""Half width of the standard normal's central 95 % interval."""


@dataclass(frozen=True)
class Coverage95:
    """Percent of errors inside the 95 % interval, by quantity; nan where there is none."""

    lon: float
    lat: float
    speed: float


@dataclass(frozen=True)
class Calibration:
    """Calibration of a set of estimates.

    Attributes:
        nees: Normalised estimation error squared over longitudinal position, lateral position and speed, divided
            by their number: 1 is honest, above is over-confident. Correlations are not reported by tracks, so it is the
            NEES of a diagonal covariance (Bar-Shalom et al. 2001, section 5.4.2).
        nees_median: Median over the estimates; an honest filter's is 0.789 (a third of the median of a chi-square
            with 3 degrees of freedom). A few far-off tracks do not move it.
        coverage95: Share of errors within 1.96 standard deviations.
        n: Number of estimates.
    """

    nees: float
    nees_median: float
    coverage95: Coverage95
    n: int


def calibration(error: FloatArray, std: FloatArray) -> Calibration:
    """Compare errors with their claimed deviations.

    Args:
        error: Errors of longitudinal position, lateral position and speed, shape (n, 3).
        std: Their claimed standard deviations, shape (n, 3); an error whose deviation is nan or not positive is left
            out.

    Returns:
        The calibration; nan without estimates.
    """
    usable = np.isfinite(error) & np.isfinite(std) & (std > 0.0)
    scaled = np.abs(np.divide(error, std, out=np.full_like(error, np.nan), where=usable))
    known = usable.sum(axis=1)
    some = known > 0
    nees = np.nansum(scaled[some] ** 2, axis=1) / known[some]
    inside = ((scaled <= NORMAL_95) & usable).sum(axis=0)
    total = usable.sum(axis=0)
    share = np.divide(100.0 * inside, total, out=np.full(3, np.nan), where=total > 0)
    return Calibration(
        nees=float(nees.mean()) if len(nees) else np.nan,
        nees_median=float(np.median(nees)) if len(nees) else np.nan,
        coverage95=Coverage95(*(float(value) for value in share)),
        n=len(nees),
    )
