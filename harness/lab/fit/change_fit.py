"""Fits the lane-change mixtures to windows around recorded lane changes.

Recorded states lie on the few paths that recorded vehicles take, and a mixture fitted to those alone ties the lateral
speed to the place on the path: a particle that is drawn apart from it in resampling is led back to a path that its
vehicle is not on. Most samples are therefore moved off the path sideways, and go on as was recorded from there: with
the same lateral acceleration.
"""

import numpy as np

from harness.lab.windows.changing import LaneChanges
from harness.lab.windows.neighbours import NeighbourStates
from mmpf.motion.learned.lane_changer import FURTHEST_NEIGHBOUR_M, TRAINED_STEP_S, ChangeView, change_inputs
from mmpf.motion.state import ACCEL, LAT, LAT_ACCEL, LAT_SPEED, LON, SPEED, STATE_SIZE
from mmpf.numerics.arrays import BoolArray, FloatArray

MISSING_GAP_SPREAD_M = 10.0
MISSING_SPEED_SPREAD_MPS = 1.0
LINE_SPREAD_M = 0.1
LINE_COLUMNS = (9, 10)
SCATTERED_SHARE = 0.7
"""Share of the samples that are moved off the recorded path."""
LAT_M, LAT_SPEED_MPS, LAT_ACCEL_MPS2 = 0.15, 0.15, 0.15
"""Standard deviations of how far, about as far as a filter's particles are apart."""
LOG_SCATTER = 0.5
"""Standard deviation of the logarithm of each sample's own factor to position and speed."""


def change_samples(
    changes: LaneChanges, rng: np.random.Generator, scattered_share: float
) -> tuple[FloatArray, FloatArray]:
    """Return inputs (n, 14) and outputs (n, 6) of table I, a share of them moved sideways.

    A sample that is moved keeps its recorded accelerations: its lateral speed after the step is off by as much as
    before, its lateral advance by as much as that speed makes of it.

    Gaps of missing neighbours scatter about 100 m and the two distances to the line scatter by 10 cm: constants and
    copies among the inputs would leave the covariances singular.
    """
    now, then = changes.state[:, :, :-1], changes.state[:, :, 1:]
    astray = np.zeros((STATE_SIZE, *now.shape[1:]))
    scattered = rng.random(now.shape[1:]) < scattered_share
    size = scattered * np.exp(LOG_SCATTER * rng.standard_normal(scattered.shape))
    astray[LAT] = LAT_M * size * rng.standard_normal(scattered.shape)
    astray[LAT_SPEED] = LAT_SPEED_MPS * size * rng.standard_normal(scattered.shape)
    astray[LAT_ACCEL] = LAT_ACCEL_MPS2 * scattered * rng.standard_normal(scattered.shape)
    flat = (now + astray).reshape(len(now), -1)
    steps = now.shape[2]
    half_width = np.repeat(0.5 * changes.lane_width_m, steps)
    crossed = flat[LAT] > half_width
    view = _view(changes, flat, crossed, rng)
    x = change_inputs(flat, np.ones(flat.shape[1]), np.zeros(flat.shape[1]), half_width, view)
    x[:, LINE_COLUMNS] += LINE_SPREAD_M * rng.standard_normal((len(x), 2))
    moved = then - now
    lat_advance = moved[LAT] + TRAINED_STEP_S * astray[LAT_SPEED]
    next_lat_speed = then[LAT_SPEED] + astray[LAT_SPEED]
    outputs = (lat_advance, moved[LON], next_lat_speed, then[SPEED], then[LAT_ACCEL], then[ACCEL])
    return x, np.stack([column.ravel() for column in outputs], axis=1)


def _view(changes: LaneChanges, flat: FloatArray, crossed: BoolArray, rng: np.random.Generator) -> ChangeView:
    own_length = np.repeat(changes.length_m, changes.state.shape[2] - 1)

    def seen(others: NeighbourStates, ahead: float, lost: BoolArray) -> tuple[FloatArray, FloatArray]:
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
