"""Fits the lane-change mixture to windows around recorded lane changes."""

from __future__ import annotations

import numpy as np

from harness.training.changing import LaneChanges, Others
from mmpf.learning.fit import fit_mixture
from mmpf.motion.lane_changer import FURTHEST_NEIGHBOUR_M, BoolArray, ChangeView, change_inputs
from mmpf.motion.scaled_gmm import ScaledGmm
from mmpf.road import FloatArray
from mmpf.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED

MISSING_GAP_SPREAD_M = 10.0
MISSING_SPEED_SPREAD_MPS = 1.0
LINE_SPREAD_M = 0.1
LINE_COLUMNS = (9, 10)


def fit_change(changes: LaneChanges, components: int, seed: int) -> ScaledGmm:
    """Fit table I's mixture to all samples of the windows."""
    x, y = change_samples(changes, np.random.default_rng(seed))
    return fit_mixture(x, y, components, seed)


def change_samples(changes: LaneChanges, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Return inputs (n, 14) and outputs (n, 6) of table I.

    Gaps of missing neighbours scatter about 100 m and the two distances to the line scatter by 10 cm: constants and
    copies among the inputs would leave the covariances singular.

    Args:
        changes: Windows around lane changes.
        rng: Source of that scatter.
    """
    now, then = changes.state[:, :, :-1], changes.state[:, :, 1:]
    flat = now.reshape(len(now), -1)
    steps = now.shape[2]
    half_width = np.repeat(0.5 * changes.lane_width_m, steps)
    crossed = flat[LAT] > half_width
    view = _view(changes, flat, crossed, rng)
    x = change_inputs(flat, np.ones(flat.shape[1]), np.zeros(flat.shape[1]), half_width, view)
    x[:, LINE_COLUMNS] += LINE_SPREAD_M * rng.standard_normal((len(x), 2))
    moved = then - now
    outputs = (moved[LAT], moved[LON], then[LAT_SPEED], then[SPEED], then[LAT_ACCEL], then[ACCEL])
    return x, np.stack([column.ravel() for column in outputs], axis=1)


def _view(changes: LaneChanges, flat: FloatArray, crossed: BoolArray, rng: np.random.Generator) -> ChangeView:
    own_length = np.repeat(changes.length_m, changes.state.shape[2] - 1)

    def seen(others: Others, ahead: float, lost: BoolArray) -> tuple[FloatArray, FloatArray]:
        distance = ahead * (others.lon_m[:, :-1].ravel() - flat[LON])
        gap = distance - 0.5 * (own_length + others.length_m[:, :-1].ravel())
        relative = others.speed_mps[:, :-1].ravel() - flat[SPEED]
        near = np.isfinite(gap) & (gap < FURTHEST_NEIGHBOUR_M) & ~lost
        missing_gap = FURTHEST_NEIGHBOUR_M + MISSING_GAP_SPREAD_M * rng.standard_normal(len(gap))
        missing_speed = MISSING_SPEED_SPREAD_MPS * rng.standard_normal(len(gap))
        return np.where(near, gap, missing_gap), np.where(near, relative, missing_speed)

    nowhere = np.zeros(len(crossed), dtype=np.bool_)
    leader = seen(changes.leader, 1.0, nowhere)
    follower = seen(changes.follower, -1.0, crossed)
    target = seen(changes.target_leader, 1.0, nowhere)
    return ChangeView(leader[0], follower[0], target[0], leader[1], follower[1], target[1])
