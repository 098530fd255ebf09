"""Learns the measurement noise of each component from its innovations, because no data sheet states it.

A detection reports its own deviation, but a partly hidden vehicle is measured worse than that, and a data sheet may be
wrong by a factor. Each component keeps the ratio of the innovations that it sees to those that it expects; a new one
begins at that of the others. After Mehra (IEEE TAC 1972): covariance matching, here recursive and bounded.
"""

from dataclasses import replace

import numpy as np

from mmpf.belief.moments import Moments
from mmpf.joint.sources import Sources
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.scan import Scan
from mmpf.stages.update_rule import Situation

FACTOR_BOUNDS = (0.4, 3.0)
LARGEST_SURPRISE = 9.0
MEMORY_S = 2.0
"""Time constant with which innovations are forgotten."""
SMALLEST_STD_M = 0.04
"""Smallest deviation of a detection: the centre of a partly visible vehicle is uncertain even if the range is exact."""
FOLLOWED_DRIFT = 0.7
"""Share of the drifting noise that the filter follows as if it were motion."""


def no_more_exact(scan: Scan) -> Scan:
    """Return the scan with positional deviations of ``SMALLEST_STD_M`` and more; unchanged where none is smaller."""
    detections = scan.detections
    if min(detections.std_lon_m.min(initial=np.inf), detections.std_lat_m.min(initial=np.inf)) >= SMALLEST_STD_M:
        return scan
    std_lon_m = np.maximum(detections.std_lon_m, SMALLEST_STD_M)
    std_lat_m = np.maximum(detections.std_lat_m, SMALLEST_STD_M)
    raised = replace(detections, std_lon_m=std_lon_m, std_lat_m=std_lat_m)
    if detections.correlation is not None:
        # What is added in one direction has nothing to do with the other.
        share = detections.std_lon_m * detections.std_lat_m / (std_lon_m * std_lat_m)
        raised = replace(raised, correlation=share * detections.correlation)
    return replace(scan, detections=raised)


def with_innovations(
    sources: Sources,
    moments: Moments,
    hit: IntArray,
    by: IntArray,
    situation: Situation,
) -> Sources:
    """Return the sources with the noise estimates updated by their innovations.

    Args:
        sources: The components.
        moments: Their moments before the scan.
        hit: Components that were detected, shape (k,).
        by: The detection of each, shape (k,).
        situation: The scan and the sensor's data sheet.
    """
    detections = situation.scan.detections
    factor = sources.noise_factor.copy()
    std_lon, std_lat = factor[hit] * detections.std_lon_m[by], factor[hit] * detections.std_lat_m[by]
    lon = (detections.lon_m[by] - moments.mean[LON][hit]) ** 2 / (moments.variance[LON][hit] + std_lon**2)
    lat = (detections.lat_m[by] - moments.mean[LAT][hit]) ** 2 / (moments.variance[LAT][hit] + std_lat**2)
    surprise = 0.5 * (np.minimum(lon, LARGEST_SURPRISE) + np.minimum(lat, LARGEST_SURPRISE))
    # The filter follows part of what drifts, so that innovations are smaller than errors.
    expected = 1.0 - FOLLOWED_DRIFT * situation.sensor.noise_correlated_share
    learned = -np.expm1(-situation.dt_s / MEMORY_S)
    factor[hit] = np.clip(factor[hit] * (1.0 + 0.5 * learned * (surprise / expected - 1.0)), *FACTOR_BOUNDS)
    return sources.having(
        noise_factor=factor,
        noise_lon_m=_smoothed(sources.noise_lon_m, hit, std_lon, learned),
        noise_lat_m=_smoothed(sources.noise_lat_m, hit, std_lat, learned),
    )


def common_factor(sources: Sources) -> float:
    """Return the initial noise factor of a new component: the root mean square of confirmed ones, else one."""
    known = sources.noise_factor[sources.confirmed]
    return float(np.sqrt((known**2).mean())) if len(known) else 1.0


def _smoothed(values: FloatArray, index: IntArray, new: FloatArray, share: float) -> FloatArray:
    smoothed = values.copy()
    old = values[index]
    smoothed[index] = np.where(old > 0.0, old + share * (new - old), new)
    return smoothed
