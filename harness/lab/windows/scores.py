"""Errors, coverage and sharpness of particles against the truth at each step."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from harness.lab.windows.cases import Cases
from harness.lab.windows.filtering import Cloud
from mmpf.motion.state import LAT, LAT_SPEED, LON, SPEED
from mmpf.numerics.arrays import FloatArray

QUANTITIES = {"lon_m": LON, "lat_m": LAT, "speed_mps": SPEED, "lat_speed_mps": LAT_SPEED}
INTERVAL = (0.025, 0.975)
HORIZONS_S = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True)
class Scores:
    """How one model did under one occlusion; arrays over steps and cases.

    Attributes:
        abs_error: Absolute error of the particles' mean by quantity, each of shape (steps - 1, m).
        covered: Whether the 95 % particle interval holds the truth, by quantity, each of shape (steps - 1, m).
        crps_m: Continuous ranked probability score of the longitudinal position, shape (steps - 1, m).
    """

    abs_error: dict[str, FloatArray]
    covered: dict[str, npt.NDArray[np.bool_]]
    spread: dict[str, FloatArray]
    crps_m: FloatArray


def score(clouds: Iterable[Cloud], cases: Cases) -> Scores:
    """Score every step's particles."""
    shape = (cases.steps - 1, cases.count)
    error = {name: np.empty(shape) for name in QUANTITIES}
    covered = {name: np.empty(shape, dtype=np.bool_) for name in QUANTITIES}
    spread = {name: np.empty(shape) for name in QUANTITIES}
    crps = np.empty(shape)
    for cloud in clouds:
        for name, row in QUANTITIES.items():
            values, true = cloud.state[row], cases.truth[cloud.step, row]
            mean = (cloud.weight * values).sum(axis=1)
            error[name][cloud.step - 1] = np.abs(mean - true)
            spread[name][cloud.step - 1] = np.sqrt((cloud.weight * (values - mean[:, None]) ** 2).sum(axis=1))
            below = (cloud.weight * (values < true[:, None])).sum(axis=1)
            up_to = (cloud.weight * (values <= true[:, None])).sum(axis=1)
            covered[name][cloud.step - 1] = (up_to >= INTERVAL[0]) & (below <= INTERVAL[1])
        crps[cloud.step - 1] = weighted_crps(cloud.state[LON], cloud.weight, cases.truth[cloud.step, LON])
    return Scores(error, covered, spread, crps)


def weighted_crps(values: FloatArray, weight: FloatArray, true: FloatArray) -> FloatArray:
    """Return the continuous ranked probability score, shape (m,), of samples whose weights sum to one, both (m, p)."""
    order = np.argsort(values, axis=1)
    values, weight = np.take_along_axis(values, order, axis=1), np.take_along_axis(weight, order, axis=1)
    cumulative = np.cumsum(weight, axis=1)
    half_mean_distance = (weight * values * (2.0 * cumulative - weight - 1.0)).sum(axis=1)
    return np.asarray((weight * np.abs(values - true[:, None])).sum(axis=1) - half_mean_distance)
