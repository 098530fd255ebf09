"""Recorded real traffic in the form of simulated recordings, so that windows can be cut from it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from harness.common.errors import InputError
from harness.lab.windows.car_following import CarFollowing, following_windows
from harness.lab.windows.recording import Recording
from harness.truth.recorded.motion import local_slope
from harness.truth.recorded.traffic import RecordedTraffic
from mmpf.map.corridor_road import highway
from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

LANE_WIDTH_M = 3.66
# So much of both ends of a pair's record is left out: there the smoothing that the source applied swings in, which
# shows as a common acceleration of followers, and braking of leaders, of 2 m/s² that the source's headways contradict.
EDGE_S = 4.0
FRAME_S = 0.1
# Rows of a pair: the follower's columns and the leader's.
FOLLOWER = ("local_y", "v_vel", "v_length")
LEADER = ("preceding_local_y", "preceding_vel", "preceding_length")
OTHER_COLUMNS = ("pair_id", "frame_id", "local_x", "lane_id")


def recording_of(traffic: RecordedTraffic) -> Recording:
    """Return recorded traffic as a recording; each stay is a vehicle."""
    columns = traffic.columns
    return Recording(
        step=traffic.step_of_row.astype(np.int64),
        vehicle=traffic.stay,
        lane=traffic.lane,
        lon_m=columns["lon_m"],
        lat_m=columns["lat_m"],
        speed_mps=columns["speed_mps"],
        lat_speed_mps=columns["lat_speed_mps"],
        accel_mps2=columns["accel_mps2"],
        length_m=columns["length_m"],
    )


def pair_windows(path: Path, steps: int, step_s: float) -> CarFollowing:
    """Cut windows from a table of leader-follower pairs; the ``vehicle`` of a window is the number of its pair.

    Args:
        path: Parquet file in NGSIM's columns, one row for each pair and tenth of a second, metres.

    Raises:
        InputError: The file is missing, broken, or lacks a column.
    """
    windows = following_windows(pairs_recording(path), pairs_road(), steps, step_s)
    led = windows.take(np.flatnonzero(windows.has_leader))
    return CarFollowing(**(vars(led) | {"vehicle": led.vehicle // 2}))


def pairs_road() -> Road:
    """Return the made-up road of the pairs: one lane, in which every pair drives alone."""
    return highway(lanes=1, lane_width_m=LANE_WIDTH_M)


def pairs_recording(path: Path) -> Recording:
    """Read a table of leader-follower pairs.

    Position is that of the front bumper in the file and that of the centre here. The gap is the difference of the
    positions, which agree with the speeds; the file's own headways jump. Accelerations are the slopes of the speeds,
    as everywhere in recorded traffic. The first and last four seconds of every stretch are left out. Sideways a
    vehicle counts from where the vehicles of its lane drive in the median.

    Raises:
        InputError: The file is missing, broken, or lacks a column.
    """
    table = _read_pairs(path)
    code = np.unique(table["pair_id"].to_numpy(dtype=str), return_inverse=True)[1]
    frame = np.round(table["frame_id"].to_numpy(dtype=np.float64)).astype(np.int64)
    order = np.lexsort((frame, code))
    table, code, frame = table.iloc[order], code[order], frame[order]
    inside = _off_the_edges(code, frame)
    table, code, frame = table[inside], np.unique(code[inside], return_inverse=True)[1], frame[inside]
    if not len(table):
        raise InputError(f"{path} has no pair on record for more than {2 * EDGE_S:g} s")
    first = np.flatnonzero(np.diff(code, prepend=-1))
    # Pairs were not there at the same time: each has steps of its own.
    since_first = frame - frame[first][code]
    step = code * (int(since_first.max()) + 2) + since_first
    stay = np.cumsum(np.diff(step, prepend=-9) != 1) - 1
    offset_m = _from_lane_middle(table)
    lat_m = pairs_road().lanes[0].centre_m + offset_m
    parts = [
        _one_of_the_pair(table, FOLLOWER, step, 2 * code, stay, lat_m),
        _one_of_the_pair(table, LEADER, step, 2 * code + 1, stay, np.full(len(step), pairs_road().lanes[0].centre_m)),
    ]
    return Recording(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _off_the_edges(code: IntArray, frame: IntArray) -> BoolArray:
    """Return which rows, sorted by pair and frame, are not near an end of a stretch on record, shape (n,)."""
    begins = np.flatnonzero((np.diff(code, prepend=-1) != 0) | (np.diff(frame, prepend=-9) != 1))
    length = np.diff(np.append(begins, len(frame)))
    since = np.arange(len(frame)) - np.repeat(begins, length)
    edge = round(EDGE_S / FRAME_S)
    return (since >= edge) & (since < np.repeat(length, length) - edge)


def _one_of_the_pair(
    table: pd.DataFrame,
    names: tuple[str, str, str],
    step: IntArray,
    vehicle: IntArray,
    stay: IntArray,
    lat_m: FloatArray,
) -> tuple[IntArray | FloatArray, ...]:
    """Return the columns of ``Recording`` in their order."""
    front_m, speed_mps, length_m = (table[name].to_numpy(dtype=np.float64) for name in names)
    return (
        step,
        vehicle,
        np.ones(len(step), dtype=np.int64),
        front_m - 0.5 * length_m,
        lat_m,
        speed_mps,
        local_slope(lat_m, stay),
        local_slope(speed_mps, stay),
        length_m,
    )


def _from_lane_middle(table: pd.DataFrame) -> FloatArray:
    """Return the lateral position, positive to the left, against the median in the same lane, shape (n,)."""
    from_left = table["local_x"].to_numpy(dtype=np.float64)
    lane = np.unique(table["lane_id"].to_numpy(dtype=str), return_inverse=True)[1]
    middle = np.array([np.median(from_left[lane == number]) for number in range(int(lane.max(initial=-1)) + 1)])
    return np.asarray(np.clip(middle[lane] - from_left, -0.49 * LANE_WIDTH_M, 0.49 * LANE_WIDTH_M))


def _read_pairs(path: Path) -> pd.DataFrame:
    try:
        table = pd.read_parquet(path)
    except FileNotFoundError:
        raise InputError(f"{path} does not exist; give a table of leader-follower pairs") from None
    except (OSError, ValueError) as error:
        raise InputError(f"{path} can't be read as parquet ({str(error).splitlines()[0]})") from None
    needed = [*OTHER_COLUMNS, *FOLLOWER, *LEADER]
    missing = [name for name in needed if name not in table]
    if missing:
        raise InputError(f"{path} has no column {', '.join(missing)}")
    if not len(table) or table[needed].isna().to_numpy().any():
        raise InputError(f"{path} has no rows, or an empty field in one of {', '.join(needed)}")
    return table
