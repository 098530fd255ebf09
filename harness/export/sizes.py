"""Sizes of tracked vehicles, taken from the detections because trackers need not report them.

A track's size is the median of those measured of the detections on it while it lived; a usual car's, where there are
none. A detection is on a track if each is the other's nearest, within the gate of the scores. No truth is used.
"""

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from harness.running.finished import RecordedRun
from harness.scoring.evidence.rules import GATE_LAT_M, GATE_LON_M
from harness.storage.schema import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M
from mmpf.numerics.arrays import FloatArray, IntArray

SIZE = ["length_m", "width_m"]
NOMINAL_M = (NOMINAL_LENGTH_M, NOMINAL_WIDTH_M)
BETWEEN_STEPS = 1e-6
"""Part of a step that counts as much as the gate: steps lie apart in one tree."""


def detection_sizes(found: pd.DataFrame) -> FloatArray:
    """Return length and width measured of detections, shape (n, 2); a usual car's where both are not."""
    measured = found.reindex(columns=SIZE).to_numpy(dtype=np.float64)
    return np.where(np.isfinite(measured).all(axis=1, keepdims=True), measured, NOMINAL_M)


def track_sizes(run: RecordedRun, episode: IntArray, track_id: IntArray) -> FloatArray:
    """Return length and width of tracks, shape (m, 2), which two columns of shape (m,) name."""
    measured = run.detections
    if set(SIZE) <= set(measured):
        measured = measured[np.isfinite(measured[SIZE].to_numpy(dtype=np.float64)).all(axis=1)]
    else:
        measured = measured[:0].reindex(columns=[*measured, *SIZE])
    track_row, detection_row = _mutual_nearest(run.tracks, measured)
    on_track = measured.iloc[detection_row]
    whose = [run.tracks[name].to_numpy()[track_row] for name in ("episode", "track_id")]
    medians = on_track[SIZE].groupby(whose).median().reindex(pd.MultiIndex.from_arrays([episode, track_id]))
    return medians.fillna(dict(zip(SIZE, NOMINAL_M, strict=True))).to_numpy(dtype=np.float64)


def _mutual_nearest(tracks: pd.DataFrame, detections: pd.DataFrame) -> tuple[IntArray, IntArray]:
    """Return the rows of tracks and of detections that are each other's nearest in their step, within the gate."""
    here, there = (
        table[["lon_m", "lat_m", "step"]].to_numpy(dtype=np.float64) / (GATE_LON_M, GATE_LAT_M, BETWEEN_STEPS)
        for table in (tracks, detections)
    )
    if not len(here) or not len(there):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    nearest, back = (np.asarray(cKDTree(b).query(a)[1]) for a, b in ((here, there), (there, here)))
    row = np.flatnonzero(back[nearest] == np.arange(len(here)))
    row = row[(np.abs(here[row] - there[nearest[row]]) <= 1.0).all(axis=1)]
    return row, nearest[row]
