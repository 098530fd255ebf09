"""Which components overlap each other or the ego."""

import numpy as np
from scipy.special import ndtr

from mmpf.belief.mixture import Components
from mmpf.belief.moments import Moments
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion.state import LAT, LON, SPEED
from mmpf.numerics.arrays import BoolArray, FloatArray, turned

# Bodies whose directions differ by more than 25 degrees reach further across than their widths.
PARALLEL = 0.9


def overlapping(components: Components, moments: Moments, share: float) -> BoolArray:
    """Return which components overlap, shape (m, m), symmetric, with a false diagonal.

    Args:
        components: The components, m of them, with their sizes.
        moments: Their moments.
        share: Two overlap whose means are nearer than this share of their mean length, and of their mean width.
    """
    length, width = components.length_m, components.width_m
    along_m, across_m = separations(moments)
    overlaps = along_m < share * 0.5 * (length[:, None] + length)
    overlaps &= across_m < share * 0.5 * (width[:, None] + width)
    # Where directions differ, one sees the other beside it and not the other way round.
    overlaps |= overlaps.T
    np.fill_diagonal(overlaps, val=False)
    return np.asarray(overlaps)


def driven_through(
    components: Components, moments: Moments, least_mps: float, dt_s: float
) -> tuple[FloatArray, FloatArray]:
    """Return which components drive through each other, which two vehicles cannot.

    Args:
        components: The components, m of them, with their sizes.
        moments: Their moments.
        least_mps: Only those whose speeds along the first one's direction differ by more pass each other.
        dt_s: Time since the scan before.

    Returns:
        Probability that the bodies of two touch while they pass each other, shape (m, m), and the share of the way
        past each other that they cover in a scan, 0 to 1, shape (m, m).
    """
    length, width, speed = components.length_m, components.width_m, moments.mean[SPEED]
    along_m, across_m = separations(moments)
    way_m, heading = length[:, None] + length, moments.heading_rad
    passing_mps = np.abs(speed[:, None] - speed * np.cos(heading[:, None] - heading))
    one, other = np.nonzero((along_m < 0.5 * way_m) & (passing_mps > least_mps))
    parallel = np.abs(np.cos(heading[one] - heading[other])) > PARALLEL
    variance = moments.std_across_m**2
    beside_m = across_m[one, other] - 0.5 * (width[one] + width[other])
    touch = np.zeros_like(across_m)
    touch[one, other] = parallel * ndtr(-beside_m / np.sqrt(np.maximum(variance[one] + variance[other], 1e-12)))
    return touch, np.minimum(passing_mps * dt_s / way_m, 1.0)


def probability_on_ego(components: Components, moments: Moments, plane: SensorPlane, share: float) -> FloatArray:
    """Return the probability that each component lies where the ego is, where no other vehicle can be, shape (m,).

    Args:
        components: The components, m of them, with their sizes.
        moments: Their moments; positions are taken as normally distributed.
        plane: The plane around the sensor.
        share: As ``overlapping`` takes it; the ego is the second body.
    """
    ego = plane.ego
    along_m, across_m = turned(moments.mean[LON] - ego.lon_m, moments.mean[LAT] - ego.lat_m, plane.ego_turn_rad)
    along = _within(along_m, share * 0.5 * (components.length_m + ego.length_m), moments.std_along_m)
    return along * _within(across_m, share * 0.5 * (components.width_m + ego.width_m), moments.std_across_m)


def _within(offset: FloatArray, reach: FloatArray, std: FloatArray) -> FloatArray:
    """Return the probability that normal values around ``offset`` lie between -``reach`` and ``reach``, shape (m,)."""
    std = np.maximum(std, 1e-6)
    return np.asarray(ndtr((reach - offset) / std) - ndtr((-reach - offset) / std))


def separations(moments: Moments) -> tuple[FloatArray, FloatArray]:
    """Return how far each component sees each other along and across its own direction, metres, both (m, m)."""
    lon, lat = moments.mean[LON], moments.mean[LAT]
    along_m, across_m = turned(lon[:, None] - lon, lat[:, None] - lat, moments.heading_rad[:, None])
    return np.abs(along_m), np.abs(across_m)
