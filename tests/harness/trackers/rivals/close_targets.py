"""The scene of Garcia-Fernandez et al. (2018), after Williams (2015): four targets that meet halfway, where one ends.

Its model: nearly constant velocity in 300 m by 300 m, scans a second apart, measured with a deviation of 1 m, detected
with a probability of 0.9 among ten false ones a scan, unknown targets a wide Gaussian from which 0.005 are born a scan.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from harness.trackers.kalman import LAT, LON, GaussianStates, predict_constant_velocity, update_variable
from harness.trackers.rivals.gaussian import pairs_of
from harness.trackers.rivals.lives import Lives
from harness.trackers.rivals.pmbm.clusters import Pruning
from harness.trackers.rivals.pmbm.mixture import (
    HypothesisMixture,
    MeasuredHypotheses,
    nothing,
    survived,
    updated_mixture,
)
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.scan import Detections
from tests.mmpf.scenes import detections_at

STEPS, TARGETS, SIDE_M = 81, 4, 300.0
NOISE, SEEN, CLUTTER, SURVIVES, BORN, AT_FIRST = 0.02, 0.9, 10.0, 0.99, 0.005, 3.0
CUTOFF_M = 10.0
REPORTED = 0.4
PRUNING = Pruning(gate_std=20.0**0.5, most=200, least_weight=1e-4, least_existence=1e-5)
BIRTH = GaussianStates(np.array([[100.0, 0.0, 100.0, 0.0]]), np.diag([150.0, 1.0, 150.0, 1.0])[None] ** 2)


@dataclass(frozen=True)
class Undetected:
    """The Poisson process of targets that were never detected, a mixture of c Gaussians.

    Attributes:
        weight: Expected number of each, shape (c,).
        states: The Gaussians.
    """

    weight: FloatArray
    states: GaussianStates

    def expected(self, detections: Detections) -> tuple[FloatArray, GaussianStates]:
        """Return how many are expected at each detection, 1/m², and what would be believed of one there."""
        share = SEEN * self.weight[:, None] * np.exp(pairs_of(self.states.mean, self.states.covariance, detections)[1])
        means, covariances = [], []
        for k in range(len(detections)):
            each = np.arange(len(self.weight))
            after = update_variable(self.states, each, LON, np.full(len(each), detections.lon_m[k]), np.ones(len(each)))
            after = update_variable(after, each, LAT, np.full(len(each), detections.lat_m[k]), np.ones(len(each)))
            part = share[:, k] / share[:, k].sum()
            mean = part @ after.mean
            off = after.mean - mean
            means.append(mean)
            covariances.append(np.einsum("c,cij->ij", part, after.covariance + off[:, :, None] * off[:, None, :]))
        states = GaussianStates(np.array(means).reshape(-1, 4), np.array(covariances).reshape(-1, 4, 4))
        return share.sum(axis=0), states

    def later(self) -> "Undetected":
        """Return it a scan later, after none of it was detected."""
        states = predict_constant_velocity(self.states, 1.0, NOISE, NOISE)
        weight = SURVIVES * (1.0 - SEEN) * self.weight
        kept = weight > 1e-5
        joined = GaussianStates(
            np.concatenate([states.mean[kept], BIRTH.mean]), np.concatenate([states.covariance[kept], BIRTH.covariance])
        )
        return Undetected(np.append(weight[kept], BORN), joined)


def scene(rng: np.random.Generator) -> FloatArray:
    """Return the targets' states at each step, shape (STEPS, TARGETS, 4)."""
    middle = STEPS // 2
    step = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 1.0], [0.0, 0.0, 0.0, 1.0]])
    unit = np.array([[1 / 3, 1 / 2], [1 / 2, 1.0]])
    root = np.linalg.cholesky(NOISE * np.kron(np.eye(2), unit))
    states = np.zeros((STEPS, TARGETS, 4))
    states[middle] = [SIDE_M / 2, 0.0, SIDE_M / 2, 0.0] + np.sqrt(0.1) * rng.standard_normal((TARGETS, 4))
    for k in range(1, middle + 1):
        drawn = rng.standard_normal((2, TARGETS, 4)) @ root.T
        states[middle + k] = states[middle + k - 1] @ step.T + drawn[0]
        states[middle - k] = (states[middle - k + 1] + drawn[1]) @ np.linalg.inv(step).T
    return states


def alive(step: int) -> IntArray:
    """Return which targets there are at a step: the first ends halfway."""
    return np.arange(1 if step >= STEPS // 2 else 0, TARGETS)


def scans(states: FloatArray, rng: np.random.Generator) -> list[FloatArray]:
    """Return the measured places of each step, each of shape (d, 2)."""
    found = []
    for k in range(STEPS):
        there = alive(k)
        seen = states[k, there[rng.random(len(there)) < SEEN]][:, [LON, LAT]]
        false = rng.uniform(0.0, SIDE_M, (rng.poisson(CLUTTER), 2))
        found.append(np.concatenate([seen + rng.standard_normal(seen.shape), false]))
    return found


def followed(found: list[FloatArray], pruning: Pruning = PRUNING) -> list[HypothesisMixture]:
    """Return the filter's beliefs after each scan."""
    mixture, undetected = nothing(pruning.alike_scans), Undetected(np.array([AT_FIRST]), BIRTH)
    believed, first_id = [], 1
    for k, places in enumerate(found):
        if k:
            states = predict_constant_velocity(mixture.singles.states, 1.0, NOISE, NOISE)
            mixture = survived(replace(mixture, singles=replace(mixture.singles, states=states)), SURVIVES)
            undetected = undetected.later()
        detections = detections_at(places.tolist(), 1.0, 1.0)
        newcomers, states = undetected.expected(detections)
        measured = MeasuredHypotheses(
            time_s=float(k),
            detections=detections,
            sizes_m=np.ones((len(places), 2)),
            seen=np.full(len(mixture.singles.existence), SEEN),
            clutter_density=np.full(len(places), CLUTTER / SIDE_M**2),
            newcomers=newcomers,
            first=(Lives.begun(first_id, len(places), float(k)), states),
        )
        first_id += len(places)
        mixture = updated_mixture(mixture, measured, pruning)
        believed.append(mixture)
    return believed


def places_of(mixture: HypothesisMixture) -> FloatArray:
    """Return where the targets are of the most probable global hypothesis that exist by 0.4 and more, shape (n, 2)."""
    best = mixture.best
    best = best[mixture.singles.existence[best] > REPORTED]
    return mixture.singles.states.mean[best][:, [LON, LAT]]


def squared_gospa(truth: FloatArray, told: FloatArray) -> float:
    """Return the square of GOSPA of order 2, cut off at 10 m (alpha 2), of places, shape (n, 2) and (m, 2)."""
    squared = np.minimum(((truth[:, None] - told) ** 2).sum(axis=-1), CUTOFF_M**2)
    rows, columns = linear_sum_assignment(squared)
    near = squared[rows, columns] < CUTOFF_M**2
    alone = len(truth) + len(told) - 2 * int(near.sum())
    return float(squared[rows, columns][near].sum() + 0.5 * CUTOFF_M**2 * alone)


def rms_gospa(states: FloatArray, runs: int, rng: np.random.Generator) -> float:
    """Return the root of the mean squared GOSPA over steps and runs, the scene's figure of merit, metres."""
    total = []
    for _ in range(runs):
        believed = followed(scans(states, rng))
        truth = [states[k, alive(k)][:, [LON, LAT]] for k in range(STEPS)]
        total += [squared_gospa(true, places_of(mixture)) for true, mixture in zip(truth, believed, strict=True)]
    return float(np.sqrt(np.mean(total)))
