"""Assigns each detection to the nearest labelled object within two metres, one to one."""

import numpy as np
from scipy.optimize import linear_sum_assignment

from harness.truth.recorded.detected.recorded_drive import Drive, step_starts
from mmpf.numerics.arrays import FloatArray, IntArray

NOTHING = -1
GATE_M = 2.0
"""Farther apart, a box that was found is none of what was labelled."""


def pairs_within(away_m: FloatArray, gate_m: float) -> tuple[IntArray, IntArray]:
    """Return pairs within the gate, one to one: as many as can be, and among those the ones nearest in sum.

    Args:
        away_m: Distances, shape (n, m).
        gate_m: The largest that makes a pair.

    Returns:
        The row and the column of each pair, rows ascending, shape (k,).
    """
    # A pair beyond the gate costs more than all pairs within it together.
    rows, columns = linear_sum_assignment(np.where(away_m <= gate_m, away_m, gate_m * (1.0 + min(away_m.shape))))
    near = away_m[rows, columns] <= gate_m
    return rows[near], columns[near]


def origins(drive: Drive) -> IntArray:
    """Return the row of the label that each detection is of, ``NOTHING`` of a false one, shape (d,).

    What is labelled but no vehicle takes detections too: a box on a tram is not false.
    """
    steps = len(drive.ego)
    label_starts, given_starts = step_starts(drive.labels.step, steps), step_starts(drive.given.step, steps)
    origin = np.full(len(drive.given), NOTHING, dtype=np.int64)
    for step in range(steps):
        labels = slice(label_starts[step], label_starts[step + 1])
        given = slice(given_starts[step], given_starts[step + 1])
        away = np.hypot(
            drive.given.x_m[given][:, None] - drive.labels.x_m[labels],
            drive.given.y_m[given][:, None] - drive.labels.y_m[labels],
        )
        found, label = pairs_within(away, GATE_M)
        origin[given_starts[step] + found] = label_starts[step] + label
    return origin
