"""What the sensor has detected of each vehicle up to each step: who is in sight, and truth identities."""

from dataclasses import dataclass

import numpy as np

from harness.scoring.evidence.rows import TruthRows
from harness.scoring.evidence.rules import IN_SIGHT_DETECTIONS, IN_SIGHT_S, MEMORY_S, TIME_TOLERANCE_S
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class DetectionHistory:
    """The detections of each vehicle up to each truth row, arrays of shape (n,) along ``TruthRows``.

    Attributes:
        last_row: Row of the vehicle's last detection at or before this row; -1 if it was never detected.
        since_s: Time since that detection; infinite if there is none.
        identity: Truth identity, new after more than the memory without detection; -1 before the first detection.
        count: Detections of that identity so far.
    """

    last_row: IntArray
    since_s: FloatArray
    identity: IntArray
    count: IntArray

    def in_sight(self) -> BoolArray:
        """Return which rows are in sight: detected often enough, and lately."""
        lately = self.since_s <= IN_SIGHT_S + TIME_TOLERANCE_S
        return lately & (self.count >= IN_SIGHT_DETECTIONS)

    def remembered(self) -> BoolArray:
        """Return which rows have been detected within the memory."""
        return self.since_s <= MEMORY_S + TIME_TOLERANCE_S


def detection_history(truth: TruthRows) -> DetectionHistory:
    """Follow each vehicle's detections through its rows, which are sorted by vehicle and step."""
    last_row = last_row_where(truth.detected, truth.vehicle)
    known = last_row >= 0
    since_s = np.full(len(truth), np.inf)
    since_s[known] = truth.time_s[known] - truth.time_s[last_row[known]]

    gap_s = np.full(len(truth), np.inf)
    gap_s[1:] = since_s[:-1] + np.diff(truth.time_s)
    gap_s[first_of_group(truth.vehicle)] = np.inf
    begins = truth.detected & (gap_s > MEMORY_S + TIME_TOLERANCE_S)
    identity = np.where(known, np.cumsum(begins) - 1, -1)

    total = np.cumsum(truth.detected)
    before = np.append(total[begins] - 1, 0)
    count = np.where(known, total - before[identity], 0)
    return DetectionHistory(last_row=last_row, since_s=since_s, identity=identity, count=count)


def last_row_where(condition: BoolArray, group: IntArray) -> IntArray:
    """Return for each row the last row of its group, up to itself, where the condition holds, or -1; shape (n,)."""
    rows = np.arange(len(group))
    starts = np.maximum.accumulate(np.where(first_of_group(group), rows, 0)) if len(rows) else rows
    last = np.maximum.accumulate(np.where(condition, rows, -1)) if len(rows) else rows
    return np.where(last >= starts, last, -1)


def first_of_group(group: IntArray) -> BoolArray:
    """Return which rows begin a group of equal neighbours, shape (n,)."""
    first = np.ones(len(group), dtype=bool)
    first[1:] = group[1:] != group[:-1]
    return first
