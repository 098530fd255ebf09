"""Constant-velocity Kalman filters of many vehicles at once, struct of arrays over n vehicles."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mmpf.road import FloatArray, IntArray

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

    def __len__(self) -> int:
        return len(self.mean)

    @property
    def std(self) -> FloatArray:
        """Standard deviation of each state variable, shape (n, 4)."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    def take(self, index: IntArray | np.ndarray[tuple[int], np.dtype[np.bool_]]) -> GaussianStates:
        """Return the chosen vehicles' beliefs."""
        return GaussianStates(self.mean[index], self.covariance[index])

    def join(self, other: GaussianStates) -> GaussianStates:
        """Return these beliefs followed by the others."""
        return GaussianStates(
            np.concatenate([self.mean, other.mean]), np.concatenate([self.covariance, other.covariance])
        )

    @classmethod
    def none(cls) -> GaussianStates:
        """Return the beliefs of no vehicle."""
        return cls(np.zeros((0, 4)), np.zeros((0, 4, 4)))


def predict_constant_velocity(
    states: GaussianStates, interval_s: float, lon_noise: float, lat_noise: float
) -> GaussianStates:
    """Predict by the nearly-constant-velocity model (Bar-Shalom, Li, Kirubarajan 2001, section 6.2.2).

    Args:
        states: Beliefs before.
        interval_s: Time to predict over.
        lon_noise: Power spectral density of the longitudinal acceleration, m^2/s^3.
        lat_noise: The same laterally.
    """
    transition = np.eye(4)
    transition[LON, SPEED] = transition[LAT, LAT_SPEED] = interval_s
    unit_noise = np.array([[interval_s**3 / 3, interval_s**2 / 2], [interval_s**2 / 2, interval_s]])
    noise = np.zeros((4, 4))
    noise[:2, :2] = lon_noise * unit_noise
    noise[2:, 2:] = lat_noise * unit_noise
    return GaussianStates(states.mean @ transition.T, transition @ states.covariance @ transition.T + noise)


def update_variable(
    states: GaussianStates, index: IntArray, variable: int, measured: FloatArray, std: FloatArray
) -> GaussianStates:
    """Update some vehicles by a direct measurement of one state variable.

    Measurements with independent errors may be taken in one after the other, so no matrix is inverted.

    Args:
        states: Beliefs before.
        index: Which vehicles are measured, each at most once, shape (k,).
        variable: ``LON``, ``SPEED``, ``LAT`` or ``LAT_SPEED``.
        measured: Measured values, shape (k,).
        std: Standard deviations of their errors, shape (k,).
    """
    prior = states.take(index)
    cross = prior.covariance[:, :, variable]
    gain = cross / (cross[:, variable] + std**2)[:, None]
    mean, covariance = states.mean.copy(), states.covariance.copy()
    mean[index] = prior.mean + gain * (measured - prior.mean[:, variable])[:, None]
    posterior = prior.covariance - gain[:, :, None] * cross[:, None, :]
    covariance[index] = 0.5 * (posterior + posterior.transpose(0, 2, 1))
    return replace(states, mean=mean, covariance=covariance)
