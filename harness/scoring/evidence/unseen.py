"""Vehicles without a track, counted on the lane pieces for which an expected number was stated."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from harness.scoring.evidence.following import Following
from harness.scoring.evidence.history import DetectionHistory, first_of_group
from harness.scoring.evidence.matching import Matching
from harness.scoring.evidence.rows import RunRows
from harness.scoring.evidence.rules import TIME_TOLERANCE_S
from mmpf.numerics.arrays import BoolArray, FloatArray

LATELY_S = 1.0
"""A vehicle detected within this time is in a tracker's hands, if not yet in a track of its."""
ON_STRETCH_M = 3.0
"""A vehicle is on the stretch that is nearest to its middle, if that is no farther away."""
LINE = ["from_lon_m", "from_lat_m", "to_lon_m", "to_lat_m"]


@dataclass(frozen=True)
class Stretches:
    """Stretches of lane at some moments, struct of arrays of shape (n,).

    Attributes:
        expected: How many vehicles without a track are expected there.
        counted: How many there are.
    """

    expected: FloatArray
    counted: FloatArray


def is_unknown(rows: RunRows, history: DetectionHistory, matching: Matching, following: Following) -> BoolArray:
    """Return which vehicles within range no track stands for, shape (n,) along ``TruthRows``.

    No track follows them, they were not detected within the last second, and the track that held them at their last
    detection, if there was one, is no longer reported: displaced it would still be one of theirs.
    """
    unfollowed = (following.track_row < 0) & (matching.holder_row < 0)
    return np.asarray(rows.truth.in_range & unfollowed & (history.since_s > LATELY_S + TIME_TOLERANCE_S))


def count_unseen(
    unseen: pd.DataFrame, rows: RunRows, history: DetectionHistory, matching: Matching, following: Following
) -> Stretches:
    """Count the vehicles that no track stands for on the stretches of a table."""
    truth = rows.truth
    counted = np.zeros(len(unseen))
    step = np.searchsorted(rows.time_s, unseen["time_s"].to_numpy(dtype=np.float64))
    lines = unseen[LINE].to_numpy(dtype=np.float64)
    unknown = np.flatnonzero(is_unknown(rows, history, matching, following))
    unknown = unknown[np.argsort(truth.step[unknown], kind="stable")]
    begins = np.flatnonzero(first_of_group(step))
    for begin, end in zip(begins, np.append(begins, len(step))[1:], strict=True):
        first, last = np.searchsorted(truth.step[unknown], (step[begin], step[begin] + 1))
        there = unknown[first:last]
        if len(there):
            away = _distances(truth.lon_m[there], truth.lat_m[there], lines[begin:end])
            nearest = away.argmin(axis=1)
            near = nearest[away.min(axis=1) <= ON_STRETCH_M]
            counted[begin:end] += np.bincount(near, minlength=end - begin)
    return Stretches(unseen["expected"].to_numpy(dtype=np.float64), counted)


def _distances(lon_m: FloatArray, lat_m: FloatArray, lines: FloatArray) -> FloatArray:
    """Return how far each of n places is from each of k lines between two ends, shape (n, k)."""
    start, step = lines[:, :2], lines[:, 2:] - lines[:, :2]
    away = np.stack([lon_m, lat_m], axis=-1)[:, None, :] - start
    share = np.clip((away * step).sum(axis=-1) / np.maximum((step**2).sum(axis=-1), 1e-12), 0.0, 1.0)
    return np.asarray(np.hypot(*np.moveaxis(away - share[..., None] * step, -1, 0)))
