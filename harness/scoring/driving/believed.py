"""A run's vehicles and tracks as bodies that a driver can believe in.

Tracks say neither how long vehicles are nor, in the plane, where they point. A track is as long as the detections on it
have been measured so far, and points where it has lately been going; no truth is used.
"""

import numpy as np
import pandas as pd

from harness.decisions.bodies import Bodies, Egos
from harness.scoring.evidence.pairs import GATE_SIMILARITY, pairs_near
from harness.scoring.evidence.rows import RunRows
from harness.scoring.evidence.rules import GATE_LON_M, TIME_TOLERANCE_S
from harness.storage.schema import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M
from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

SIZES = ("length_m", "width_m")
# A track's direction is that of its motion over this time, if it has come this far.
HEADING_S, HEADING_M = 0.5, 0.5


def egos_of(truth: pd.DataFrame, rows: RunRows) -> tuple[Egos, BoolArray]:
    """Return the ego at each step, shape (steps,), and the steps with an ego; elsewhere its place is nan."""
    there = rows.ego_row >= 0
    table = truth.iloc[rows.ego_row[there]]

    def column(name: str, missing: float) -> FloatArray:
        values = np.full(len(there), missing)
        if name in table:
            values[there] = table[name].to_numpy(dtype=np.float64)
        return values

    egos = Egos(
        episode=rows.episode,
        lon_m=column("lon_m", np.nan),
        lat_m=column("lat_m", np.nan),
        speed_mps=column("speed_mps", 0.0),
        lane=column("lane", 0.0).astype(np.int64),
        length_m=column("length_m", NOMINAL_LENGTH_M),
        width_m=column("width_m", NOMINAL_WIDTH_M),
    )
    return egos, there


def true_bodies(truth: pd.DataFrame, rows: RunRows) -> Bodies:
    """Return the vehicles, in the order of ``TruthRows``."""
    vehicles = rows.truth
    sizes = [truth[name].to_numpy(dtype=np.float64)[vehicles.name_row] for name in SIZES]
    return Bodies(
        vehicles.step, vehicles.lon_m, vehicles.lat_m, vehicles.speed_mps, vehicles.direction_rad, sizes[0], sizes[1]
    )


def tracked_bodies(detections: pd.DataFrame, rows: RunRows, egos: Egos, road: Road) -> Bodies:
    """Return the reported tracks in the order of ``TrackRows``; a track without speed gets the ego's speed."""
    tracks = rows.tracks
    order = np.lexsort((tracks.step, tracks.track))
    length, width = _measured_so_far(detections, rows, order)
    direction = road.axis_of(_headings(rows, order))
    speed = np.where(np.isfinite(tracks.speed_mps), tracks.speed_mps, egos.speed_mps[tracks.step])
    return Bodies(tracks.step, tracks.lon_m, tracks.lat_m, speed, direction, length, width)


def _measured_so_far(detections: pd.DataFrame, rows: RunRows, order: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return length and width of each track: the mean of those measured on it up to now, a usual car's if none were."""
    tracks, nominal = rows.tracks, (NOMINAL_LENGTH_M, NOMINAL_WIDTH_M)
    if not set(SIZES) <= set(detections) or not len(tracks):
        return np.full(len(tracks), nominal[0]), np.full(len(tracks), nominal[1])
    measured = [detections[name].to_numpy(dtype=np.float64) for name in SIZES]
    near = pairs_near(rows.detections, tracks, GATE_LON_M)
    near = near.where((near.similarity >= GATE_SIMILARITY) & np.isfinite(measured[0] + measured[1])[near.truth])
    best = np.lexsort((-near.similarity, near.track))
    best = best[np.append(True, np.diff(near.track[best]) > 0)[: len(best)]]
    on_track, of_track = near.truth[best], near.track[best]
    group = tracks.track[order]
    found = np.zeros(len(tracks))
    found[of_track] = 1.0
    count = _sum_so_far(found[order], group)
    means = []
    for values, usual in zip(measured, nominal, strict=True):
        summed = np.zeros(len(tracks))
        summed[of_track] = values[on_track]
        mean = np.full(len(tracks), usual)
        total = _sum_so_far(summed[order], group)
        mean[order] = np.divide(total, count, out=np.full(len(tracks), usual), where=count > 0.5)
        means.append(mean)
    return means[0], means[1]


def _sum_so_far(values: FloatArray, group: IntArray) -> FloatArray:
    """Return the sum of each row and those before it in its group, which no other group's rows round, shape (m,)."""
    return np.asarray(pd.Series(values).groupby(group, sort=False).cumsum(), dtype=np.float64)


def _headings(rows: RunRows, order: IntArray) -> FloatArray:
    """Return each track's direction of motion over the last half second, nan where it hardly moved, shape (m,)."""
    tracks = rows.tracks
    group, time_s = tracks.track[order], rows.time_s[tracks.step[order]]
    # Times grow within a track, and a track's rows stand together: one search finds each row's beginning.
    span = float(rows.time_s[-1] - rows.time_s[0]) + 2.0 if len(rows.time_s) else 1.0
    key = group * span + time_s
    back = np.searchsorted(key, np.maximum(key - HEADING_S - TIME_TOLERANCE_S, group * span + rows.time_s[0] - 0.5))
    lon, lat = tracks.lon_m[order], tracks.lat_m[order]
    off_lon, off_lat = lon - lon[back], lat - lat[back]
    moved = np.hypot(off_lon, off_lat) >= HEADING_M
    direction = np.full(len(tracks), np.nan)
    direction[order[moved]] = np.arctan2(off_lat, off_lon)[moved]
    return direction
