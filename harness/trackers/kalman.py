"""Kalman filters of many vehicles at once: nearly constant velocity, measured directly, reported as tracks."""

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from harness.trackers.track_options import KalmanOptions
from mmpf.numerics.arrays import FloatArray, IntArray, taken
from mmpf.scan import Detections, EgoPose
from mmpf.tracks import Tracks

LON, SPEED, LAT, LAT_SPEED = range(4)


@dataclass(frozen=True)
class GaussianStates:
    """Gaussian beliefs of n vehicles.

    Attributes:
        mean: Longitudinal position and speed, lateral position and speed, shape (n, 4).
        covariance: Shape (n, 4, 4).
    """

    mean: FloatArray
    covariance: FloatArray

    @property
    def std(self) -> FloatArray:
        """Standard deviation of each state variable, shape (n, 4)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))


def predict_constant_velocity(
    states: GaussianStates, interval_s: float, lon_noise: float, lat_noise: float
) -> GaussianStates:
    """Predict by the nearly-constant-velocity model (Bar-Shalom, Li, Kirubarajan 2001, section 6.2.2)."""
    transition = np.eye(4)
    transition[LON, SPEED] = transition[LAT, LAT_SPEED] = interval_s
    unit_noise = np.array([[interval_s**3 / 3, interval_s**2 / 2], [interval_s**2 / 2, interval_s]])
    noise = np.zeros((4, 4))
    noise[:2, :2] = lon_noise * unit_noise
    noise[2:, 2:] = lat_noise * unit_noise
    return GaussianStates(states.mean @ transition.T, transition @ states.covariance @ transition.T + noise)


def update_variable(
    states: GaussianStates,
    index: IntArray,
    variable: int,
    measured: FloatArray,
    std: FloatArray,
    slope: FloatArray | float = 0.0,
) -> GaussianStates:
    """Update some vehicles by a direct measurement of one state variable.

    Measurements with independent errors may be taken in one after the other, so no matrix is inverted.

    Args:
        index: Which vehicles are measured, each at most once, shape (k,).
        slope: Measured is the variable minus this times the longitudinal position, shape (k,).
    """
    prior, slope = taken(states, index), np.reshape(slope, (-1, 1))
    cross = prior.covariance[:, :, variable] - slope * prior.covariance[:, :, LON]
    variance = cross[:, [variable]] - slope * cross[:, [LON]] + np.reshape(std**2, (-1, 1))
    gain = cross / variance
    expected = prior.mean[:, [variable]] - slope * prior.mean[:, [LON]]
    mean, covariance = states.mean.copy(), states.covariance.copy()
    mean[index] = prior.mean + gain * (measured[:, None] - expected)
    posterior = prior.covariance - gain[:, :, None] * cross[:, None, :]
    covariance[index] = 0.5 * (posterior + posterior.transpose(0, 2, 1))
    return replace(states, mean=mean, covariance=covariance)


def updated(states: GaussianStates, index: IntArray, detections: Detections, detection: IntArray) -> GaussianStates:
    """Return beliefs after a detection each of some of them: place, and speed where it is measured.

    Args:
        states: Beliefs before.
        index: Whose detections they are, each at most once, shape (k,).
        detections: All detections.
        detection: Which of them, shape (k,).
    """
    lon_m, lat_m = detections.lon_m[detection], detections.lat_m[detection]
    std_lon_m, std_lat_m = detections.std_lon_m[detection], detections.std_lat_m[detection]
    correlation = np.zeros(len(lon_m)) if detections.correlation is None else detections.correlation[detection]
    # What the two places' errors share is taken out of the second, so that the rest is independent of the first.
    slope, rest = correlation * std_lat_m / std_lon_m, np.sqrt(1.0 - correlation**2)
    states = update_variable(states, index, LON, lon_m, std_lon_m)
    states = update_variable(states, index, LAT, lat_m - slope * lon_m, rest * std_lat_m, slope)
    has_speed = np.isfinite(detections.speed_mps[detection])
    measured, std = detections.speed_mps[detection], detections.std_speed_mps[detection]
    return update_variable(states, index[has_speed], SPEED, measured[has_speed], std[has_speed])


def newborn(detections: Detections, detection: IntArray, ego: EgoPose, options: KalmanOptions) -> GaussianStates:
    """Return first beliefs of k vehicles: as fast as the ego where speed is not measured.

    Args:
        detection: Which of them begin a belief, shape (k,).
    """
    count = len(detection)
    has_speed = np.isfinite(detections.speed_mps[detection])
    speed = np.where(has_speed, detections.speed_mps[detection], ego.speed_mps)
    std_speed = np.where(has_speed, detections.std_speed_mps[detection], options.birth_speed_std_mps)
    std_lat_speed = np.full(count, options.birth_lat_speed_std_mps)
    mean = np.column_stack([detections.lon_m[detection], speed, detections.lat_m[detection], np.zeros(count)])
    std = np.column_stack([detections.std_lon_m[detection], std_speed, detections.std_lat_m[detection], std_lat_speed])
    covariance = std[:, :, None] ** 2 * np.eye(4)
    covariance[:, [LON, LAT], [LAT, LON]] = detections.covariance_m2[detection, 0, 1, None]
    return GaussianStates(mean, covariance)


def tracks_of(
    track_id: IntArray,
    mean: FloatArray,
    std: FloatArray,
    state: npt.NDArray[np.int8],
    existence: FloatArray | None = None,
) -> Tracks:
    """Return beliefs as they are reported.

    Args:
        mean: Means that begin with ``LON, SPEED, LAT, LAT_SPEED``, shape (n, 4 or more).
        existence: Probability that each is a vehicle, shape (n,); one if None.
    """
    return Tracks(
        track_id=track_id,
        lon_m=mean[:, LON],
        lat_m=mean[:, LAT],
        speed_mps=mean[:, SPEED],
        lat_speed_mps=mean[:, LAT_SPEED],
        accel_mps2=np.zeros(len(mean)),
        std_lon_m=std[:, LON],
        std_lat_m=std[:, LAT],
        std_speed_mps=std[:, SPEED],
        existence=np.ones(len(mean)) if existence is None else existence,
        state=state,
    )
