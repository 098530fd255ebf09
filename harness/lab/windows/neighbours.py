"""The vehicles ahead of and behind each row of a recording, in its own and the adjacent lanes."""

from dataclasses import dataclass, fields

import numpy as np

from harness.lab.windows.recording import Recording
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, IntArray

NOBODY = -1
# Places from 25 km behind the road's origin to 75 km beyond it have keys of their own lane.
_STEP_KEY, _LANE_KEY, _BEHIND_M = 1e7, 1e5, 2.5e4


@dataclass(frozen=True)
class NeighbourStates:
    """One neighbour of each window's vehicle, arrays of shape (windows, steps); nan where there is none."""

    lon_m: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray
    length_m: FloatArray


def nearest_row(recording: Recording, step: IntArray, lane: IntArray, lon_m: FloatArray, *, ahead: bool) -> IntArray:
    """Return the row of the nearest vehicle strictly ahead of each place, or behind it, ``NOBODY`` for none."""
    keys = _key(recording.step, recording.lane, recording.lon_m)
    row = np.argsort(keys, kind="stable")
    place = np.searchsorted(keys, _key(step, lane, lon_m), "right" if ahead else "left", sorter=row)
    if not ahead:
        place = place - 1
    row = row[np.clip(place, 0, len(row) - 1)]
    lane_start = step * _STEP_KEY + lane * _LANE_KEY
    same_lane = (keys[row] >= lane_start) & (keys[row] < lane_start + _LANE_KEY)
    return np.where((place >= 0) & (place < len(keys)) & same_lane, row, NOBODY)


def clear_gap_m(recording: Recording, behind: IntArray, ahead: IntArray) -> FloatArray:
    """Return the bumper-to-bumper distance between the vehicles of two sets of rows; infinite where one is missing."""
    missing = (behind == NOBODY) | (ahead == NOBODY)
    half_lengths = 0.5 * (recording.length_m[behind] + recording.length_m[ahead])
    return np.where(missing, np.inf, recording.lon_m[ahead] - recording.lon_m[behind] - half_lengths)


def others_at(recording: Recording, rows: IntArray) -> NeighbourStates:
    """Return the vehicles of some rows of a recording; nan where a row is ``NOBODY``."""
    columns = (getattr(recording, column.name) for column in fields(NeighbourStates))
    return NeighbourStates(*(np.where(rows == NOBODY, np.nan, column[rows]) for column in columns))


def lane_lines(road: Road, lane: IntArray) -> FloatArray:
    """Return the right and the left line of lanes, by their numbers, shape (n, 2); nan of one that the road lacks."""
    lines = {one.number: (one.right_m, one.left_m) for one in road.lanes}
    return np.array([lines.get(number, (np.nan, np.nan)) for number in lane.tolist()]).reshape(-1, 2)


def _key(step: IntArray, lane: IntArray, lon_m: FloatArray) -> FloatArray:
    return np.asarray(step * _STEP_KEY + lane * _LANE_KEY + lon_m + _BEHIND_M)
