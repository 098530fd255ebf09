"""Are the trackers' standard deviations honest?"""

from __future__ import annotations

import numpy as np

from harness.scoring.evidence import Evidence
from harness.sensor.observation import HIDDEN
from mmpf.compute.arrays import BoolArray, FloatArray

NORMAL_95 = 1.959963984540054
"""Half width of the standard normal's central 95 % interval."""
ERRORS = ["lon_error_m", "lat_error_m", "speed_error_mps"]
DEVIATIONS = ["std_lon_m", "std_lat_m", "std_speed_mps"]


def calibration_by_visibility(evidence: Evidence) -> dict[str, object]:
    """Return the calibration over all followed vehicles, and of the (partly) ``visible`` and ``hidden`` among them."""
    error, std = (evidence.error_table[columns].to_numpy(dtype=np.float64) for columns in (ERRORS, DEVIATIONS))
    followed, hidden = evidence.errors.tracked, evidence.errors.state == HIDDEN

    def of(chosen: BoolArray) -> dict[str, object]:
        return calibration(error[chosen], std[chosen])

    return {**of(followed), "visible": of(followed & ~hidden), "hidden": of(followed & hidden)}


def calibration(error: FloatArray, std: FloatArray) -> dict[str, object]:
    """Compare errors with their claimed deviations.

    Args:
        error: Errors of longitudinal position, lateral position and speed, shape (n, 3).
        std: Their claimed standard deviations, shape (n, 3); an error whose deviation is nan or not positive is left
            out.

    Returns:
        ``nees``: normalised estimation error squared over the three, divided by their number: 1 is honest, above is
        over-confident. Correlations are not reported by tracks, so it is the NEES of a diagonal covariance (Bar-Shalom
        et al. 2001, section 5.4.2). ``nees_median``: its median, which a few far-off tracks do not move; an honest
        filter's is 0.789 (a third of the median of a chi-square with 3 degrees of freedom). ``coverage95``: percent of
        errors within 1.96 standard deviations, of each quantity. ``n``: number of estimates. nan without estimates.
    """
    usable = np.isfinite(error) & np.isfinite(std) & (std > 0.0)
    scaled = np.abs(np.divide(error, std, out=np.full_like(error, np.nan), where=usable))
    known = usable.sum(axis=1)
    some = known > 0
    nees = np.nansum(scaled[some] ** 2, axis=1) / known[some]
    inside = ((scaled <= NORMAL_95) & usable).sum(axis=0)
    total = usable.sum(axis=0)
    share = np.divide(100.0 * inside, total, out=np.full(3, np.nan), where=total > 0)
    return {
        "nees": float(nees.mean()) if len(nees) else np.nan,
        "nees_median": float(np.median(nees)) if len(nees) else np.nan,
        "coverage95": dict(zip(("lon", "lat", "speed"), share.tolist(), strict=True)),
        "n": len(nees),
    }
