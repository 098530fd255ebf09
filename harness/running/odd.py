"""Tells what is unlikely of a run's tables that can be read: recordings of the data sets stay far below every limit."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.spatial import cKDTree

from harness.common.bounds import LEAP_MPS
from harness.storage import run_folder as runfolder
from mmpf.map.road import NO_LANE, Road
from mmpf.numerics.arrays import FloatArray, IntArray, wrapped
from mmpf.scan import UNKNOWN_CLASS, VEHICLE_CLASSES

WINDOW_S = 0.5
"""Over which moves are measured, so that noise of places matters little."""
MOVING_MPS, TURNED_RAD, HARDEST_MPS2, NEAR_M, GROWTH = 3.0, np.deg2rad(30.0), 15.0, 1.0, 1.3
LENGTH_M, WIDTH_M, LONGEST_M, STD_M = (2.5, 12.0), (1.2, 3.5), 26.0, (0.005, 100.0)
MOST_ODD, FEWEST, FAR_M, MANY, MOST_MPS2 = 0.02, 20, 10.0, 0.5, 50.0
APART_M = 1e6
"""Between steps, where places of all steps are in one tree."""
told: set[tuple[str, float]] = set()
"""What this process has said: a grid reads one recording many times."""


def tell_oddities(tables: Mapping[str, pd.DataFrame], road: Road) -> None:
    """Write a line to stderr, once, if truth, detections or tracks of a run are unlikely."""
    truth, detections, tracks = (tables[name] for name in (runfolder.TRUTH, runfolder.DETECTIONS, runfolder.TRACKS))
    found = [f"a vehicle {kind}" for kind in oddities(truth, road)] + odd_reports(truth, detections, tracks)
    line, which = "; ".join(found), float(truth["lon_m"].sum())
    if line and (line, which) not in told:
        told.add((line, which))
        sys.stderr.write(f"warning: this is unlikely: {line}; check units, axes, times and names of the input\n")


def odd_reports(truth: pd.DataFrame, detections: pd.DataFrame, tracks: pd.DataFrame) -> list[str]:
    """Return what is unlikely of detections and tracks beside the truth, in words."""
    there = cKDTree(_places(truth))
    of = truth.set_index(["step", "vehicle_id"])[["lon_m", "lat_m"]]
    own = of[~of.index.duplicated()].reindex(pd.MultiIndex.from_frame(detections[["step", "truth_id"]])).to_numpy()
    off_m = np.hypot(*(detections[["lon_m", "lat_m"]].to_numpy() - own).T)
    shares = {
        "detections are over 10 m from their vehicles": _share(off_m[np.isfinite(off_m)] > FAR_M),
        "tracks are over 10 m from any vehicle": _share(np.asarray(there.query(_places(tracks))[0]) > FAR_M),
        "tracks move not as fast as they say": _unlike(tracks, tracks["track_id"].to_numpy())
        * bool(tracks["speed_mps"].any()),
        "tracks speed up by over 50 m/s2": _share(tracks["accel_mps2"].abs() > MOST_MPS2),
        "tracks have deviations of under 5 mm or over 100 m": _share(
            (tracks["std_lon_m"] < STD_M[0]) | (tracks["std_lon_m"] > STD_M[1])
        ),
    }
    return [kind for kind, share in shares.items() if share > MANY]


def oddities(truth: pd.DataFrame, road: Road | None = None) -> list[str]:
    """Return what is unlikely of vehicles of a table of truth, in words; people on foot do not count."""
    if "pedestrian" in truth:
        truth = truth[~truth["pedestrian"].fillna(False).astype(bool)]
    if "vehicle_class" in truth:  # where some are known, others are no vehicles
        truth = truth[truth["vehicle_class"] != VEHICLE_CLASSES[UNKNOWN_CLASS]]
    rows = truth.sort_values(["episode", "vehicle_id", "step"], kind="stable", ignore_index=True)
    who = rows.groupby(["episode", "vehicle_id"], sort=False).ngroup().to_numpy(dtype=np.int64)
    if len(rows) < FEWEST:
        return []
    if rows["step"].min() == rows["step"].max():
        return ["is on record at one moment"]
    first, last = _windows(rows, who)
    along, time_s, heading = (rows[name].to_numpy(dtype=np.float64) for name in ("speed_mps", "time_s", "heading_rad"))
    moved = np.full((len(rows), 2), np.nan)
    moved[first] = _velocity(rows, first, last)
    went = np.hypot(*moved[first].T)
    middle = heading[first] + 0.5 * wrapped(heading[last] - heading[first])
    off = np.abs(wrapped(np.arctan2(*moved[first].T[::-1]) - middle))
    change = np.hypot(*(moved[last] - moved[first]).T) / (time_s[last] - time_s[first])
    one = (np.diff(who) == 0) & (np.diff(rows["step"]) == 1)
    pairs = cKDTree(_places(rows)).query_pairs(NEAR_M, output_type="ndarray")
    size = rows.groupby(who)[["length_m", "width_m"]]
    length_m, width_m = size.median().to_numpy().T
    # Whoever reads logs in the plane puts none on a lane.
    mapped = road is not None and (bool(road.lanes) or (any(True for _ in road.lines()) and rows["lane"].any()))
    beside = rows["lane"].to_numpy()[np.abs(along) > MOVING_MPS] == NO_LANE
    usual = LENGTH_M[0] <= np.median(length_m) <= LENGTH_M[1] and WIDTH_M[0] <= np.median(width_m) <= WIDTH_M[1]
    shares = {
        "moves not where it points": _share(off[went > MOVING_MPS] > TURNED_RAD),
        "moves not as fast as it says": 0.5 * _unlike(rows, who),
        "drives faster than 259 km/h": _share(went > 0.9 * LEAP_MPS),
        "changes its speed at once": max(
            _share(change > HARDEST_MPS2), _share(np.abs(np.diff(along)[one] / np.diff(time_s)[one]) > 3 * HARDEST_MPS2)
        ),
        "is where another is": max(len(pairs) / len(rows), float(rows["is_ego"].to_numpy(dtype=bool)[pairs].any())),
        "changes its size": 0.2 * _share((size.max() / size.min()).to_numpy().max(axis=1) > GROWTH),
        "is wider than long": _share(width_m > length_m),
        "is longer than 26 m": float((length_m > LONGEST_M).any()),
        "is on record at one moment": (_share(np.bincount(who) == 1) - MANY) * (len(length_m) > FEWEST),
        "drives beside the lanes": (_share(beside) - MANY) * mapped,
        "has no usual size": float(len(length_m) > 2 and not usual),
    }
    return [kind for kind, share in shares.items() if share > MOST_ODD]


def _places(rows: pd.DataFrame) -> FloatArray:
    return rows[["lon_m", "lat_m", "step"]].to_numpy(dtype=np.float64) * (1.0, 1.0, APART_M)


def _windows(rows: pd.DataFrame, who: npt.NDArray[Any]) -> tuple[IntArray, IntArray]:
    """Return rows and those of the same one a window later; the rows are sorted by who and step."""
    time_s, step = rows["time_s"].to_numpy(), rows["step"].to_numpy()
    next_s = np.diff(time_s)[np.diff(who) == 0]
    count = max(1, round(WINDOW_S / max(float(np.median(next_s)), 1e-3))) if len(next_s) else 1
    first = np.flatnonzero((who[count:] == who[:-count]) & (step[count:] - step[:-count] == count))
    return first, first + count


def _velocity(rows: pd.DataFrame, first: IntArray, last: IntArray) -> FloatArray:
    xyt = rows[["lon_m", "lat_m", "time_s"]].to_numpy(dtype=np.float64)
    gone = xyt[last] - xyt[first]
    return np.asarray(gone[:, :2] / gone[:, 2:])


def _unlike(rows: pd.DataFrame, who: npt.NDArray[Any]) -> float:
    """Return the share of rows of which the speed is not that of the move that begins or ends there."""
    order = np.lexsort((rows["step"], who))
    rows, who = rows.iloc[order], who[order]
    first, last = _windows(rows, who)
    says, went = np.hypot(*rows[["speed_mps", "lat_speed_mps"]].to_numpy().T), _velocity(rows, first, last)
    said, speed = 0.5 * (says[first] + says[last]), np.hypot(*went.T)
    return _share(np.abs(said - speed) > 1.5 + 0.2 * np.maximum(said, speed))


def _share(odd: npt.NDArray[np.bool_] | pd.Series) -> float:
    return float(odd.mean()) if len(odd) else 0.0
