"""Which vehicle-steps are in plain view: every tracker must have a track there, whatever was detected.

Truth alone decides. A vehicle that the sensor hardly ever detects is in plain view as much as any other.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from harness.scoring.evidence.history import first_of_group, last_row_where
from harness.scoring.evidence.rows import RunRows
from harness.scoring.evidence.rules import PLAIN_VIEW_M, PLAIN_VIEW_S, TIME_TOLERANCE_S
from harness.storage.schema import VISIBLE
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, StringArray


@dataclass(frozen=True)
class PlainView:
    """The vehicle-steps in plain view, arrays of shape (n,) along ``TruthRows`` unless stated otherwise.

    Attributes:
        near: In plain view (visible to the sensor's full-view fraction or more, within its range) and near the ego:
            within ``PLAIN_VIEW_M``, centre to centre.
        lasting: In plain view for ``PLAIN_VIEW_S`` without interruption, near or not.
        counted: Near and lasting.
        away_m: Distance from the ego; nan at a step without an ego.
        step_s: Time that each row's step stands for.
        names: Name of each vehicle by its code, shape (vehicles,).
    """

    near: BoolArray
    lasting: BoolArray
    counted: BoolArray
    away_m: FloatArray
    step_s: FloatArray
    names: StringArray


def plain_view(truth: pd.DataFrame, rows: RunRows) -> PlainView:
    """Find the vehicle-steps in plain view in the table of truth, which has the ego's place."""
    vehicles = rows.truth
    places = (truth[name].to_numpy(dtype=np.float64) for name in ("lon_m", "lat_m"))
    ego_lon, ego_lat = (np.append(place, np.nan)[rows.ego_row] for place in places)
    away_m = np.hypot(vehicles.lon_m - ego_lon[vehicles.step], vehicles.lat_m - ego_lat[vehicles.step])
    plain = vehicles.in_range & (vehicles.state == VISIBLE)
    near = plain & (away_m <= PLAIN_VIEW_M)
    in_view_s = lasting_s(plain, vehicles.vehicle, vehicles.step, vehicles.time_s)
    lasting = in_view_s >= PLAIN_VIEW_S - TIME_TOLERANCE_S
    first = np.flatnonzero(first_of_group(vehicles.vehicle)) if len(vehicles) else np.zeros(0, dtype=np.int64)
    return PlainView(
        near=near,
        lasting=lasting,
        counted=near & lasting,
        away_m=away_m,
        step_s=durations(rows.time_s, rows.episode)[vehicles.step],
        names=truth["vehicle_id"].to_numpy(dtype=object)[vehicles.name_row[first]].astype(np.str_),
    )


def begins(holds: BoolArray, vehicle: IntArray, step: IntArray) -> BoolArray:
    """Return the rows at which something begins to hold of a vehicle, shape (n,); a step without a row ends it."""
    before = np.zeros(len(holds), dtype=bool)
    before[1:] = holds[:-1] & (vehicle[1:] == vehicle[:-1]) & (np.diff(step) == 1)
    return holds & ~before


def lasting_s(holds: BoolArray, vehicle: IntArray, step: IntArray, time_s: FloatArray) -> FloatArray:
    """Return for how long something has held of a vehicle without interruption, -1 where it does not, shape (n,)."""
    since = last_row_where(begins(holds, vehicle, step), vehicle)
    return np.where(holds, time_s - time_s[since], -1.0) if len(holds) else np.zeros(0)


def durations(time_s: FloatArray, episode: IntArray) -> FloatArray:
    """Return the time that each step stands for: until the next one, or the usual time where none follows, (steps,)."""
    lasts = np.append(np.diff(time_s), np.nan)[: len(time_s)]
    ends = np.append(first_of_group(episode)[1:], True)[: len(time_s)]
    usual = float(np.median(lasts[~ends])) if (~ends).any() else 0.1
    return np.where(ends, usual, lasts)
