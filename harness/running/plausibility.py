"""Warns of what is implausible in a run's tables; real recordings of unusual places may be warned of too."""

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.spatial import cKDTree

from harness.common.bounds import LEAP_MPS
from harness.common.streams import to_stderr
from harness.storage import run_folder as runfolder
from mmpf.map.road import NO_LANE, Road
from mmpf.numerics.arrays import FloatArray, IntArray, wrapped

WINDOW_S = 0.5
"""Over which moves are measured, so that noise of places matters little."""
MOVING_MPS, TURNED_RAD, HARDEST_MPS2, NEAR_M, GROWTH = 3.0, np.deg2rad(30.0), 15.0, 1.0, 1.3
LENGTH_M, WIDTH_M, LONGEST_M, STD_M = (2.5, 12.0), (1.2, 3.5), 26.0, (0.005, 100.0)
FEWEST_ROWS, FEWEST_VEHICLES, FAR_M, MOST_MPS2 = 20, 20, 10.0, 50.0
FEW, SOME, HALF = 0.02, 0.1, 0.5
"""Shares of rows or vehicles above which a check fails."""
APART_M = 1e6
"""Between steps, where places of all steps are in one tree."""


class Check(NamedTuple):
    """A check: what is implausible, in which share of cases it is so, and the largest share that is usual."""

    words: str
    share: float
    most: float


def warn_of_implausible(tables: Mapping[str, pd.DataFrame], road: Road, told: set[str]) -> None:
    """Write a line to stderr if truth, detections or tracks of a run, its tables by file name, are implausible.

    Args:
        told: What the run's earlier stretches were told of, which is not told of again; what is new is added.
    """
    truth, detections, tracks = (tables[name] for name in (runfolder.TRUTH, runfolder.DETECTIONS, runfolder.TRACKS))
    found = [f"a vehicle {kind}" for kind in implausible_truth(truth, road)]
    found += implausible_reports(truth, detections, tracks)
    if new := "; ".join(kind for kind in found if kind.partition(" (")[0] not in told):
        to_stderr(f"warning: this is unlikely: {new}; check its frame, units, axes, times and names, or the tracker")
    told.update(kind.partition(" (")[0] for kind in found)


def implausible_reports(truth: pd.DataFrame, detections: pd.DataFrame, tracks: pd.DataFrame) -> list[str]:
    """Return what is implausible in tables of detections and tracks beside that of the truth, in words.

    Tracks may follow clutter, as most do at the start of a run among few vehicles. On a full road, tracks in another
    frame lie near vehicles out of range.
    """
    of_one, near = detections["truth_id"] != "", truth[truth["in_range"].astype(bool) | truth["is_ego"].astype(bool)]
    there = cKDTree(np.vstack([_places(near), _places(detections[~of_one] if of_one.any() else detections[:0])]))
    of = truth.set_index(["step", "vehicle_id"])[["lon_m", "lat_m"]]
    own = of[~of.index.duplicated()].reindex(pd.MultiIndex.from_frame(detections[["step", "truth_id"]])).to_numpy()
    off_m = np.hypot(*(detections[["lon_m", "lat_m"]].to_numpy() - own).T)
    away_m = np.asarray(there.query(_places(tracks))[0])
    median_m = np.median(away_m) if len(away_m) else 0.0
    has_speeds, std_m = bool(tracks["speed_mps"].any()), tracks["std_lon_m"]
    shares = {
        "detections are over 10 m from their vehicles": _share(off_m[np.isfinite(off_m)] > FAR_M),
        f"tracks are over 10 m from any vehicle (median {median_m:.0f} m)": _share(away_m > FAR_M),
        "tracks move not as fast as they say": _unlike(tracks, tracks["track_id"].to_numpy()) * has_speeds,
        "tracks speed up by over 50 m/s2": _share(tracks["accel_mps2"].abs() > MOST_MPS2),
        "tracks have deviations of under 5 mm or over 100 m": _share((std_m < STD_M[0]) | (std_m > STD_M[1])),
    }
    return [kind for kind, share in shares.items() if share > HALF]


def implausible_truth(truth: pd.DataFrame, road: Road | None = None) -> list[str]:
    """Return what is implausible of vehicles of a table of truth, in words; people on foot do not count."""
    if "pedestrian" in truth:
        truth = truth[~truth["pedestrian"].fillna(False).astype(bool)]
    # Of recordings with a detector's boxes, what is no vehicle is never in range.
    truth = truth[truth["is_ego"].astype(bool) | truth.groupby(["episode", "vehicle_id"])["in_range"].transform("any")]
    rows = truth.sort_values(["episode", "vehicle_id", "step"], kind="stable", ignore_index=True)
    if len(rows) < FEWEST_ROWS:
        return []
    if rows["step"].min() == rows["step"].max():
        return ["is on record at one moment"]
    who = rows.groupby(["episode", "vehicle_id"], sort=False).ngroup().to_numpy(dtype=np.int64)
    found = [*_checks_of_moves(rows, who), *_checks_of_places(rows, road), *_checks_of_sizes(rows, who)]
    return [each.words for each in found if each.share > each.most]


def _checks_of_moves(rows: pd.DataFrame, who: npt.NDArray[Any]) -> Iterator[Check]:
    first, last = _windows(rows, who)
    along, time_s, heading = (rows[name].to_numpy(dtype=np.float64) for name in ("speed_mps", "time_s", "heading_rad"))
    moved = np.full((len(rows), 2), np.nan)
    moved[first] = _velocity(rows, first, last)
    went_mps = np.hypot(*moved[first].T)
    middle = heading[first] + 0.5 * wrapped(heading[last] - heading[first])
    off_rad = np.abs(wrapped(np.arctan2(*moved[first].T[::-1]) - middle))
    change_mps2 = np.hypot(*(moved[last] - moved[first]).T) / (time_s[last] - time_s[first])
    next_step = (np.diff(who) == 0) & (np.diff(rows["step"]) == 1)
    said_mps2 = np.abs(np.diff(along)[next_step] / np.diff(time_s)[next_step])
    at_once = max(_share(change_mps2 > HARDEST_MPS2), _share(said_mps2 > 3.0 * HARDEST_MPS2))
    yield Check("moves not where it points", _share(off_rad[went_mps > MOVING_MPS] > TURNED_RAD), FEW)
    backwards = (along[first] * np.cos(off_rad) < -MOVING_MPS)[went_mps > MOVING_MPS]
    yield Check("moves not as fast as it says", max(_unlike(rows, who), _share(backwards)), 2.0 * FEW)
    yield Check("drives faster than 259 km/h", _share(went_mps > 0.9 * LEAP_MPS), FEW)
    yield Check("changes its speed at once", at_once, FEW)
    yield Check("is on record at one moment", _share(np.bincount(who) == 1), HALF if who[-1] >= FEWEST_VEHICLES else 1)


def _checks_of_places(rows: pd.DataFrame, road: Road | None) -> Iterator[Check]:
    pairs = cKDTree(_places(rows)).query_pairs(NEAR_M, output_type="ndarray")
    # In sound logs a vehicle that stands is annotated twice, and riders are on what they ride.
    moves, rides = np.abs(rows["speed_mps"]) > MOVING_MPS, rows["width_m"] < WIDTH_M[0]
    either = [each.to_numpy(dtype=bool)[pairs].any(axis=1) for each in (rows["is_ego"], moves, rides)]
    with_ego, in_drive = bool(either[0].any()), either[0] | either[1] & ~either[2]
    # Whoever reads logs in the plane puts none on a lane.
    mapped = road is not None and (bool(road.lanes) or (any(True for _ in road.lines()) and rows["lane"].any()))
    off_lanes = rows["lane"].to_numpy()[np.abs(rows["speed_mps"]) > MOVING_MPS] == NO_LANE
    yield Check("is where another is", in_drive.sum() / len(rows), 0.0 if with_ego else FEW)
    yield Check("stands where another is", (~in_drive).sum() / len(rows), SOME)
    yield Check("drives beside the lanes", _share(off_lanes), HALF if mapped else 1.0)


def _checks_of_sizes(rows: pd.DataFrame, who: npt.NDArray[Any]) -> Iterator[Check]:
    size = rows.groupby(who)[["length_m", "width_m"]]
    length_m, width_m = size.median().to_numpy().T
    usual = LENGTH_M[0] <= np.median(length_m) <= LENGTH_M[1] and WIDTH_M[0] <= np.median(width_m) <= WIDTH_M[1]
    yield Check("changes its size", _share((size.max() / size.min()).to_numpy().max(axis=1) > GROWTH), SOME)
    yield Check("is wider than long", _share(width_m > length_m), FEW)
    yield Check("is longer than 26 m", float((length_m > LONGEST_M).any()), 0.0)
    yield Check("has no usual size", float(len(length_m) > 2 and not usual), 0.0)


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


def _share(cases: npt.NDArray[np.bool_] | pd.Series) -> float:
    return float(cases.mean()) if len(cases) else 0.0
