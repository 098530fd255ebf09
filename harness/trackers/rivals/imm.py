"""Interacting multiple models (Blom and Bar-Shalom 1988) of many vehicles at once, in the Cartesian plane.

There are two models. One keeps its velocity (CV): a linear Kalman filter. The other keeps its acceleration along its
way and its rate of turning (CTRA): an extended one. Both have the same state, and what CV knows nothing of,
acceleration and rate of turning, has its prior there, so that a vehicle which begins to manoeuvre draws both from it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from harness.trackers.kalman import LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray, IntArray, taken
from mmpf.scan import Detections

ACCEL, TURN = 4, 5
STATE_SIZE = 6
CV, CTRA = range(2)
MODELS = 2
_VELOCITY = [SPEED, LAT_SPEED]
_PLACE = [LON, LAT]
# Below this speed a vehicle has no direction along which it could be accelerated.
_LEAST_SPEED_MPS = 1.0


@dataclass(frozen=True)
class Manoeuvres:
    """How vehicles move.

    Attributes:
        lon_noise: Power spectral density of the longitudinal acceleration, m²/s³, in both models.
        lat_noise: The same laterally.
        accel_std_mps2: Stationary deviation of the acceleration while a vehicle manoeuvres.
        turn_std_rad_per_s: Stationary deviation of the rate of turning.
        fade_s: Time constant with which both fade (Singer's model).
    """

    lon_noise: float
    lat_noise: float
    accel_std_mps2: float
    turn_std_rad_per_s: float
    fade_s: float

    @property
    def prior_variance(self) -> FloatArray:
        """Variances of acceleration and rate of turning, shape (2,)."""
        return np.array([self.accel_std_mps2**2, self.turn_std_rad_per_s**2])


@dataclass(frozen=True)
class ModelBeliefs:
    """What each model believes of n vehicles.

    Attributes:
        mean: Shape (n, MODELS, STATE_SIZE).
        covariance: Shape (n, MODELS, STATE_SIZE, STATE_SIZE).
        probability: Of each model, shape (n, MODELS).
    """

    mean: FloatArray
    covariance: FloatArray
    probability: FloatArray


def mixed(beliefs: ModelBeliefs, transition: FloatArray) -> ModelBeliefs:
    """Return what each model starts the next step from, with the models' probabilities before the next detection.

    Args:
        beliefs: After the last detection.
        transition: Probability of each model (column) after each (row), shape (MODELS, MODELS).
    """
    joint = beliefs.probability[:, :, None] * transition
    ahead = joint.sum(axis=1)
    weight = joint / np.maximum(ahead[:, None, :], 1e-300)
    mean = np.einsum("nij,nia->nja", weight, beliefs.mean)
    offset = beliefs.mean[:, :, None, :] - mean[:, None, :, :]
    spread = beliefs.covariance[:, :, None] + offset[..., :, None] * offset[..., None, :]
    return ModelBeliefs(mean, np.einsum("nij,nijab->njab", weight, spread), ahead)


def predicted(beliefs: ModelBeliefs, interval_s: float, manoeuvres: Manoeuvres) -> ModelBeliefs:
    """Return the beliefs a while later, each model's by its own."""
    mean, covariance = np.empty_like(beliefs.mean), np.empty_like(beliefs.covariance)
    mean[:, CV], covariance[:, CV] = _kept_velocity(beliefs.mean[:, CV], beliefs.covariance[:, CV], interval_s)
    mean[:, CTRA], jacobian = turned_and_accelerated(beliefs.mean[:, CTRA], interval_s, manoeuvres.fade_s)
    covariance[:, CTRA] = jacobian @ beliefs.covariance[:, CTRA] @ jacobian.transpose(0, 2, 1)
    white = _white_acceleration(interval_s, manoeuvres)
    fades = 1.0 - np.exp(-2.0 * interval_s / manoeuvres.fade_s)
    prior = np.zeros((STATE_SIZE, STATE_SIZE))
    prior[[ACCEL, TURN], [ACCEL, TURN]] = manoeuvres.prior_variance
    covariance[:, CV] += white + prior
    covariance[:, CTRA] += white + fades * prior
    return replace(beliefs, mean=mean, covariance=0.5 * (covariance + covariance.transpose(0, 1, 3, 2)))


def turned_and_accelerated(mean: FloatArray, interval_s: float, fade_s: float) -> tuple[FloatArray, FloatArray]:
    """Return means a while later under constant turn rate and acceleration, and the derivatives of these.

    The place moves by the velocity at half time, which is off by the interval's third power.

    Args:
        mean: Means, shape (n, STATE_SIZE).
        interval_s: How much later.
        fade_s: Time constant with which acceleration and turn rate decay.

    Returns:
        Means, shape (n, STATE_SIZE), and Jacobians, shape (n, STATE_SIZE, STATE_SIZE).
    """
    later = mean.copy()
    jacobian = np.zeros((len(mean), STATE_SIZE, STATE_SIZE))
    halfway, half_by_state = _velocity_after(mean, 0.5 * interval_s)
    velocity, by_state = _velocity_after(mean, interval_s)
    later[:, _PLACE] += interval_s * halfway
    later[:, _VELOCITY] = velocity
    jacobian[:, _PLACE, _PLACE] = 1.0
    jacobian[:, _PLACE] += interval_s * half_by_state
    jacobian[:, _VELOCITY] = by_state
    kept = np.exp(-interval_s / fade_s)
    later[:, [ACCEL, TURN]] *= kept
    jacobian[:, [ACCEL, TURN], [ACCEL, TURN]] = kept
    return later, jacobian


def updated(beliefs: ModelBeliefs, index: IntArray, detections: Detections, detection: IntArray) -> ModelBeliefs:
    """Return the beliefs after a detection each of some vehicles: place, and speed where it is measured.

    Args:
        beliefs: Before them.
        index: Which vehicles, each at most once, shape (k,).
        detections: All detections.
        detection: Which of them, shape (k,).
    """
    prior = taken(beliefs, index)
    mean, covariance = prior.mean, prior.covariance
    log_likelihood = np.zeros(prior.probability.shape)
    measured = (
        (LON, detections.lon_m, detections.std_lon_m),
        (LAT, detections.lat_m, detections.std_lat_m),
        (SPEED, detections.speed_mps, detections.std_speed_mps),
    )
    for row, values, stds in measured:
        value, std = values[detection], stds[detection]
        there = np.isfinite(value)
        if not there.any():
            continue
        off = np.where(there, value, 0.0)[:, None] - mean[..., row]
        cross = covariance[..., row]
        variance = cross[..., row] + np.where(there, std, np.inf)[:, None] ** 2
        gain = cross / variance[..., None]
        mean = mean + gain * np.where(there[:, None], off, 0.0)[..., None]
        covariance = covariance - gain[..., :, None] * cross[..., None, :]
        known = -0.5 * (off**2 / variance + np.log(2.0 * np.pi * np.where(there[:, None], variance, 1.0)))
        log_likelihood += np.where(there[:, None], known, 0.0)
    weight = prior.probability * np.exp(log_likelihood - log_likelihood.max(axis=1, keepdims=True))
    after = ModelBeliefs(beliefs.mean.copy(), beliefs.covariance.copy(), beliefs.probability.copy())
    after.mean[index] = mean
    after.covariance[index] = 0.5 * (covariance + np.swapaxes(covariance, -1, -2))
    after.probability[index] = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-300)
    return after


def combined(beliefs: ModelBeliefs) -> tuple[FloatArray, FloatArray]:
    """Return the mean and covariance over models, shapes (n, STATE_SIZE) and (n, STATE_SIZE, STATE_SIZE)."""
    mean = np.einsum("nj,nja->na", beliefs.probability, beliefs.mean)
    offset = beliefs.mean - mean[:, None]
    spread = beliefs.covariance + offset[..., :, None] * offset[..., None, :]
    return mean, np.einsum("nj,njab->nab", beliefs.probability, spread)


def stays(interval_s: float, mean_stay_s: tuple[float, float]) -> FloatArray:
    """Return the probability of each model (column) after each (row) a while later, shape (MODELS, MODELS).

    Args:
        interval_s: How much later.
        mean_stay_s: How long a vehicle keeps to each model in the mean: CV, CTRA.
    """
    leave = 1.0 / np.array(mean_stay_s)
    total = leave.sum()
    changed = -np.expm1(-total * interval_s) * leave / total
    return np.array([[1.0 - changed[CV], changed[CV]], [changed[CTRA], 1.0 - changed[CTRA]]])


def _kept_velocity(mean: FloatArray, covariance: FloatArray, interval_s: float) -> tuple[FloatArray, FloatArray]:
    """Predict by constant velocity; what there was of acceleration and turning is forgotten."""
    transition = np.diag([1.0, 1.0, 1.0, 1.0, 0.0, 0.0])
    transition[_PLACE, _VELOCITY] = interval_s
    return mean @ transition.T, transition @ covariance @ transition.T


def _white_acceleration(interval_s: float, manoeuvres: Manoeuvres) -> FloatArray:
    unit = np.array([[interval_s**3 / 3, interval_s**2 / 2], [interval_s**2 / 2, interval_s]])
    noise = np.zeros((STATE_SIZE, STATE_SIZE))
    noise[:2, :2], noise[2:4, 2:4] = manoeuvres.lon_noise * unit, manoeuvres.lat_noise * unit
    return noise


def _velocity_after(mean: FloatArray, interval_s: float) -> tuple[FloatArray, FloatArray]:
    """Return velocities a while later, shape (n, 2), and their derivatives by the state, shape (n, 2, STATE_SIZE)."""
    velocity, accel = mean[:, _VELOCITY], mean[:, ACCEL]
    speed = np.hypot(velocity[:, 0], velocity[:, 1])
    scale = np.maximum(speed, _LEAST_SPEED_MPS)
    gained = accel * interval_s / scale
    straight = velocity * (1.0 + gained)[:, None]
    angle = mean[:, TURN] * interval_s
    rotation = _rotation(angle)
    by_state = np.zeros((len(mean), 2, STATE_SIZE))
    outer = velocity[:, :, None] * velocity[:, None, :]
    falls = np.where(speed > _LEAST_SPEED_MPS, gained / scale**2, 0.0)
    by_velocity = (1.0 + gained)[:, None, None] * np.eye(2) - falls[:, None, None] * outer
    by_state[:, :, _VELOCITY] = rotation @ by_velocity
    by_accel = velocity * (interval_s / scale)[:, None]
    by_state[:, :, ACCEL] = np.einsum("nab,nb->na", rotation, by_accel)
    by_state[:, :, TURN] = interval_s * np.einsum("nab,nb->na", _rotation(angle + 0.5 * np.pi), straight)
    return np.einsum("nab,nb->na", rotation, straight), by_state


def _rotation(angle_rad: FloatArray) -> FloatArray:
    cosine, sine = np.cos(angle_rad), np.sin(angle_rad)
    return np.stack([np.stack([cosine, -sine], axis=-1), np.stack([sine, cosine], axis=-1)], axis=-2)
