"""Vectorised Gaussian association: distances, likelihoods and pairs."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from harness.trackers.kalman import LAT, LON
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.scan import Detections

_TWO_PI = 2.0 * np.pi


def pairs_of(mean: FloatArray, covariance: FloatArray, detections: Detections) -> tuple[FloatArray, FloatArray]:
    """Compare each of n beliefs with each of d detections by position.

    Args:
        mean: Means whose rows are those of ``kalman.LON`` and so on, shape (n, 4 or more).
        covariance: Covariances of the same order.
        detections: The detections, d of them.

    Returns:
        Squared Mahalanobis distances, and logarithms of the densities of the detections' places, 1/m², each (n, d).
    """
    off_lon = detections.lon_m - mean[:, LON, None]
    off_lat = detections.lat_m - mean[:, LAT, None]
    noise_m2 = detections.covariance_m2
    lon_lon = covariance[:, LON, LON, None] + noise_m2[:, 0, 0]
    lat_lat = covariance[:, LAT, LAT, None] + noise_m2[:, 1, 1]
    lon_lat = covariance[:, LON, LAT, None] + noise_m2[:, 0, 1]
    determinant = lon_lon * lat_lat - lon_lat**2
    squared = (lat_lat * off_lon**2 - 2.0 * lon_lat * off_lon * off_lat + lon_lon * off_lat**2) / determinant
    return squared, -0.5 * squared - 0.5 * np.log(determinant) - np.log(_TWO_PI)


def best_pairs(gain: FloatArray, allowed: BoolArray) -> tuple[IntArray, IntArray]:
    """Return the one-to-one pairs of rows and columns whose gains are greatest in sum, of those that are allowed.

    Args:
        gain: Gains, shape (n, d); a pair is worth nothing if its gain is not positive.
    """
    worth = np.where(allowed, np.maximum(gain, 0.0), 0.0)
    rows, columns = linear_sum_assignment(worth, maximize=True)
    chosen = worth[rows, columns] > 0.0
    return rows[chosen].astype(np.int64), columns[chosen].astype(np.int64)
