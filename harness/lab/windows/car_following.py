"""Windows of a recording in which a vehicle follows one leader, or none, in one lane."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.ndimage import maximum_filter1d

from harness.lab.windows.neighbours import NOBODY, NeighbourStates, clear_gap_m, lane_lines, nearest_row, others_at
from harness.lab.windows.recording import Recording, joined_apart, load_all
from harness.truth.frame import STEP_S
from mmpf.map.road import NO_LANE, Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, taken

STEPS = 101
"""States of a window of 10 s."""
LANE_CHANGE_MARGIN_S = 5.0
FURTHEST_LEADER_M = 100.0
CUT_IN_LEAST_M = 2.0


@dataclass(frozen=True)
class CarFollowing:
    """Windows of equal length of one vehicle each; arrays of shape (windows, steps) unless said.

    Attributes:
        lon_m: Longitudinal position of the vehicle's centre.
        offset_m: Lateral position from the middle of its lane.
        length_m: Vehicle length, shape (windows,).
        lane_width_m: Width of its lane, shape (windows,).
        vehicle: A number that windows of the same vehicle share, shape (windows,).
        after_cut_in: Whether the window begins with a new leader, nearer than the last, shape (windows,).
        traffic: A number that windows of the same recording share, shape (windows,).
    """

    lon_m: FloatArray
    offset_m: FloatArray
    speed_mps: FloatArray
    lat_speed_mps: FloatArray
    accel_mps2: FloatArray
    length_m: FloatArray
    lane_width_m: FloatArray
    leader: NeighbourStates
    vehicle: IntArray
    after_cut_in: BoolArray
    traffic: IntArray

    def __len__(self) -> int:
        return len(self.length_m)

    @property
    def has_leader(self) -> BoolArray:
        """Whether each window has a leader, shape (windows,)."""
        return np.isfinite(self.leader.length_m[:, 0])

    @property
    def gap_m(self) -> FloatArray:
        """Clear distance to the leader, shape (windows, steps)."""
        return self.leader.lon_m - self.lon_m - 0.5 * (self.length_m[:, None] + self.leader.length_m)

    @property
    def led(self) -> CarFollowing:
        """The windows with a leader."""
        return taken(self, self.has_leader)


def following_windows(recording: Recording, road: Road, steps: int) -> CarFollowing:
    """Cut a recording into windows without lane changes nearby, whose leader stays the same.

    A window's vehicle changes no lane within the window nor in the five seconds before and after it; a leader further
    than 100 m ahead counts as none, and windows in which one comes or goes are left out.
    """
    by_vehicle = np.lexsort((recording.step, recording.vehicle))
    step, vehicle, lane = (column[by_vehicle] for column in (recording.step, recording.vehicle, recording.lane))
    ahead = nearest_row(recording, step, lane, recording.lon_m[by_vehicle], ahead=True)
    gap = clear_gap_m(recording, by_vehicle, ahead)
    gap = np.where(gap < FURTHEST_LEADER_M, gap, np.inf)
    leader = np.where(np.isfinite(gap), ahead, NOBODY)
    leader_vehicle = np.where(leader == NOBODY, NOBODY, recording.vehicle[leader])
    changes, around = ~_unchanged(lane) & _unchanged(vehicle), 2 * round(LANE_CHANGE_MARGIN_S / STEP_S) + 1
    settled = ~maximum_filter1d(changes, around, mode="constant", cval=False) & (lane != NO_LANE)
    same_as_before = (
        _unchanged(vehicle) & _unchanged(leader_vehicle) & _unchanged(lane) & (np.diff(step, prepend=-9) == 1)
    )
    nearer = np.concatenate([[False], gap[1:] < gap[:-1] - CUT_IN_LEAST_M])
    new_leader = ~_unchanged(leader_vehicle) & _unchanged(vehicle) & _unchanged(lane) & nearer
    goes_on = settled & same_as_before & np.concatenate([[False], settled[:-1]])
    run_start = np.flatnonzero(~goes_on)
    run_length = np.diff(np.append(run_start, len(settled)))
    windows = np.where(settled[run_start], run_length // steps, 0)
    offset = np.arange(windows.sum()) - np.repeat(np.cumsum(windows) - windows, windows)
    start = np.repeat(run_start, windows) + offset * steps
    own, leaders = (rows[start[:, None] + np.arange(steps)] for rows in (by_vehicle, leader))
    lines, others = lane_lines(road, lane[start]), others_at(recording, leaders)
    # A leader is as long as it is at the beginning.
    others = replace(others, length_m=np.repeat(others.length_m[:, :1], steps, axis=1))
    return CarFollowing(
        lon_m=recording.lon_m[own],
        offset_m=recording.lat_m[own] - lines.mean(axis=1)[:, None],
        speed_mps=recording.speed_mps[own],
        lat_speed_mps=recording.lat_speed_mps[own],
        accel_mps2=recording.accel_mps2[own],
        length_m=recording.length_m[own[:, 0]],
        lane_width_m=lines[:, 1] - lines[:, 0],
        leader=others,
        vehicle=vehicle[start],
        after_cut_in=new_leader[start],
        traffic=np.zeros(len(start), dtype=np.int64),
    )


def load_following(paths: Sequence[Path], road: Road) -> CarFollowing:
    """Cut recordings that lie in files into windows of 10 s."""
    return joined_apart(
        [following_windows(recording, road, STEPS) for recording in load_all(paths)], "vehicle", "traffic"
    )


def _unchanged(column: IntArray) -> BoolArray:
    return np.concatenate([[False], column[1:] == column[:-1]])
