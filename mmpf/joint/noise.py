"""How noisy the detections of each component are: measured by its innovations, since no data sheet knows.

A detection reports its own deviation, but a partly hidden vehicle is measured worse than that, and a data sheet may be
wrong by a factor. Each component keeps the ratio of the innovations that it sees to those that it expects; a new one
begins at that of the others. After Mehra (IEEE TAC 1972): covariance matching, here recursive and bounded.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mmpf.cloud.mixture import Components
from mmpf.cloud.moments import Moments
from mmpf.compute.arrays import FloatArray, IntArray
from mmpf.options import JointNoise
from mmpf.scan import Detections
from mmpf.state import LAT, LON

FACTOR_BOUNDS = (0.4, 3.0)
LARGEST_SURPRISE = 9.0


def with_innovations(
    components: Components,
    moments: Moments,
    detections: Detections,
    hit: IntArray,
    by: IntArray,
    correlated_share: float,
    options: JointNoise,
    dt_s: float,
) -> Components:
    """Return the components with what their detections say of the noise.

    Args:
        components: The components.
        moments: Their moments before the scan.
        detections: The scan's detections.
        hit: Components that were detected, shape (k,).
        by: The detection of each, shape (k,).
        correlated_share: Share of the noise's variance that drifts: the filter follows part of it, so that innovations
            are smaller than errors.
        options: How fast the noise is learned.
        dt_s: Time since the scan before.
    """
    factor = components.noise_factor.copy()
    std_lon, std_lat = factor[hit] * detections.std_lon_m[by], factor[hit] * detections.std_lat_m[by]
    lon = (detections.lon_m[by] - moments.mean[LON][hit]) ** 2 / (moments.variance[LON][hit] + std_lon**2)
    lat = (detections.lat_m[by] - moments.mean[LAT][hit]) ** 2 / (moments.variance[LAT][hit] + std_lat**2)
    surprise = 0.5 * (np.minimum(lon, LARGEST_SURPRISE) + np.minimum(lat, LARGEST_SURPRISE))
    expected = 1.0 - options.followed_drift * correlated_share
    learned = -np.expm1(-dt_s / options.memory_s)
    factor[hit] = np.clip(factor[hit] * (1.0 + 0.5 * learned * (surprise / expected - 1.0)), *FACTOR_BOUNDS)
    return replace(
        components,
        noise_factor=factor,
        noise_lon_m=_smoothed(components.noise_lon_m, hit, std_lon, learned),
        noise_lat_m=_smoothed(components.noise_lat_m, hit, std_lat, learned),
    )


def common_factor(components: Components) -> float:
    """Return the noise factor that a new component begins with: the confirmed ones' root mean square, one if none."""
    known = components.noise_factor[components.confirmed]
    return float(np.sqrt((known**2).mean())) if len(known) else 1.0


def _smoothed(values: FloatArray, index: IntArray, new: FloatArray, share: float) -> FloatArray:
    smoothed = values.copy()
    old = values[index]
    smoothed[index] = np.where(old > 0.0, old + share * (new - old), new)
    return smoothed
