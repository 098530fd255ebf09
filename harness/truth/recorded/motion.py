"""Computes speeds, headings and accelerations where a recording lacks them or has them wrong.

Recorded accelerations are second differences of noisy positions and are never used. Acceleration is the slope of the
speed, and a speed that the file does not state the slope of the position, by least squares over half a second to
either side: as much as the simulated traffic is smoothed by.
"""

from dataclasses import replace

import numpy as np

from harness.truth.frame import STEP_S
from harness.truth.recorded.resample import Clocked
from harness.truth.recorded.rows import Rows
from mmpf.numerics.arrays import FloatArray, IntArray, turned, wrapped

HALF_WIDTH_STEPS = 5
CREEP_MPS = 2.0


def completed(clocked: Clocked) -> tuple[Rows, FloatArray]:
    """Fill in what is nan in the rows, and return them with the longitudinal acceleration of each, shape (n,)."""
    if clocked.in_plane:
        return _completed_in_plane(clocked)
    rows, stay = clocked.rows, clocked.stay
    speed = _filled(rows.speed_mps, rows.lon_m, stay)
    lat_speed = _filled(rows.lat_speed_mps, rows.lat_m, stay)
    # A vehicle drifts along its heading; while it creeps most of its lateral speed is noise of the recording.
    drift = np.arctan2(lat_speed, np.maximum(np.maximum(np.abs(speed), 3.0 * np.abs(lat_speed)), CREEP_MPS))
    heading = np.where(np.isnan(rows.heading_rad), drift, rows.heading_rad)
    heading = (heading + np.pi) % (2.0 * np.pi) - np.pi
    return replace(rows, heading_rad=heading, speed_mps=speed, lat_speed_mps=lat_speed), local_slope(speed, stay)


def _completed_in_plane(clocked: Clocked) -> tuple[Rows, FloatArray]:
    """Do the same where speeds are along and across each vehicle's own heading."""
    rows, stay = clocked.rows, clocked.stay
    # Step by step along and across the heading of that step, so that a turn alone is no drift.
    step_x, step_y = (np.diff(values, prepend=values[:1]) for values in (rows.lon_m, rows.lat_m))
    heading = rows.heading_rad - 0.5 * wrapped(np.diff(rows.heading_rad, prepend=rows.heading_rad[:1]))
    same = np.diff(stay, prepend=-1) == 0
    along, across = (np.cumsum(np.where(same, moved, 0.0)) for moved in turned(step_x, step_y, heading))
    speed, lat_speed = _filled(rows.speed_mps, along, stay), _filled(rows.lat_speed_mps, across, stay)
    return replace(rows, speed_mps=speed, lat_speed_mps=lat_speed), local_slope(speed, stay)


def local_slope(values: FloatArray, stay: IntArray) -> FloatArray:
    """Return the derivative in time of values on the clock, by least squares over neighbours of the same stay.

    Near the ends of a stay the neighbours on one side are fewer; a lone row has slope 0.

    Args:
        values: On the clock, sorted by stay and time, shape (n,).
        stay: Stay of each row, shape (n,).

    Returns:
        The slopes per second, shape (n,).
    """
    count, sum_t, sum_tt = np.ones(len(values)), np.zeros(len(values)), np.zeros(len(values))
    sum_v, sum_tv = np.zeros(len(values)), np.zeros(len(values))
    for reach in range(1, min(HALF_WIDTH_STEPS, len(values) - 1) + 1):
        same = (stay[reach:] == stay[:-reach]).astype(np.float64)
        rise = same * (values[reach:] - values[:-reach])
        for side, slope_t in ((np.s_[:-reach], reach), (np.s_[reach:], -reach)):
            count[side] += same
            sum_t[side] += slope_t * same
            sum_tt[side] += slope_t * slope_t * same
            # Relative to the row's own value, so that no digits are lost far down the road.
            difference = rise if slope_t > 0 else -rise
            sum_v[side] += difference
            sum_tv[side] += slope_t * difference
    spread = count * sum_tt - sum_t * sum_t
    slope = (count * sum_tv - sum_t * sum_v) / np.where(spread > 0.0, spread, 1.0)
    return np.asarray(slope / STEP_S)


def _filled(stated: FloatArray, position: FloatArray, stay: IntArray) -> FloatArray:
    unknown = np.isnan(stated)
    return np.where(unknown, local_slope(position, stay), stated) if unknown.any() else stated
