"""The table of errors: one row per step and once-detected vehicle, with its track and the error."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from harness.scoring.evidence.directions import along_and_across
from harness.scoring.evidence.history import DetectionHistory
from harness.scoring.evidence.matching import Matching
from harness.scoring.evidence.pairs import similarity
from harness.scoring.evidence.rows import RunRows, label_codes
from harness.storage.schema import HIDDEN, MATCHED_BY, OUT, OUTCOMES, VISIBILITY_STATES
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

TRACKED, MISSED, LOST, HIJACKED, UNTRACKED = range(5)


@dataclass(frozen=True)
class ErrorArrays:
    """The numbers of the error table, struct of arrays of shape (n,); ``outcome`` and ``state`` are indices.

    ``absolute`` has the absolute errors of longitudinal and lateral position, longitudinal and lateral speed, shape (n,
    4); ``seconds_hidden`` is 0 where not hidden.
    """

    vehicle: IntArray
    absolute: FloatArray
    state: IntArray
    seconds_hidden: FloatArray
    outcome: IntArray

    @property
    def tracked(self) -> BoolArray:
        """Rows that belong in a mean, shape (n,)."""
        return np.equal(self.outcome, TRACKED)


def error_table(truth: pd.DataFrame, rows: RunRows, history: DetectionHistory, matching: Matching) -> pd.DataFrame:
    """Tabulate the errors of the tracks, estimate minus truth, that MAE and calibration are computed from.

    There is a row for every vehicle and step in range, from the vehicle's first detection on and while its last one
    is at most ``MEMORY_S`` ago. Outcomes of a visible or partly visible vehicle: *tracked* (matched within the gate)
    or *missed*. Outcomes of a hidden vehicle, judged by the track that held it when it was last detected: *tracked*,
    *lost* (that track is no longer reported), *hijacked* (that track is matched to another vehicle and nearer to it),
    or *untracked* (no track held it). The errors of a hijacked vehicle are in the table but in no mean.
    Errors of the position are along and across the vehicle's direction; deviations are as the tracker reports them,
    along the frame's axes.

    Returns:
        The table ``errors`` of ``harness.storage.schema``, sorted by step and vehicle.
    """
    vehicles, tracks = rows.truth, rows.tracks
    kept = scored_rows(rows, history)
    hidden = vehicles.state[kept] == HIDDEN
    track_row = np.where(hidden, matching.holder_row[kept], matching.track_row[kept])
    followed = track_row >= 0
    stolen = hidden & _is_stolen(rows, matching, kept, track_row)
    held = matching.holder[kept] >= 0
    outcome = np.where(
        followed,
        np.where(stolen, HIJACKED, TRACKED),
        np.where(hidden, np.where(held, LOST, UNTRACKED), MISSED),
    )
    lon_m, lat_m = along_and_across(
        _of_track(tracks.lon_m, track_row) - vehicles.lon_m[kept],
        _of_track(tracks.lat_m, track_row) - vehicles.lat_m[kept],
        vehicles.direction_rad[kept],
    )
    return pd.DataFrame(
        {
            "step": truth["step"].to_numpy()[vehicles.name_row[kept]],
            "time_s": vehicles.time_s[kept],
            "episode": rows.episode[vehicles.step[kept]],
            "vehicle_id": truth["vehicle_id"].take(vehicles.name_row[kept]).to_numpy(),
            "track_id": np.append(tracks.track_id, -1)[track_row],
            "state": _labels(vehicles.state[kept], VISIBILITY_STATES),
            "seconds_hidden": np.where(hidden, history.since_s[kept], 0.0),
            "lon_error_m": lon_m,
            "lat_error_m": lat_m,
            "speed_error_mps": _of_track(tracks.speed_mps, track_row) - vehicles.speed_mps[kept],
            "lat_speed_error_mps": _of_track(tracks.lat_speed_mps, track_row) - vehicles.lat_speed_mps[kept],
            "std_lon_m": _of_track(tracks.std_lon_m, track_row),
            "std_lat_m": _of_track(tracks.std_lat_m, track_row),
            "std_speed_mps": _of_track(tracks.std_speed_mps, track_row),
            "matched_by": _labels(np.where(followed, np.where(hidden, 2, 1), 0), MATCHED_BY),
            "outcome": _labels(outcome, OUTCOMES),
        }
    )


def scored_rows(rows: RunRows, history: DetectionHistory) -> IntArray:
    """Return the truth rows that the error table has a row for, in its order, shape (n,)."""
    vehicles = rows.truth
    kept = np.flatnonzero(vehicles.in_range & (vehicles.state != OUT) & history.remembered())
    return kept[np.lexsort((vehicles.vehicle[kept], vehicles.step[kept]))]


def error_arrays(errors: pd.DataFrame) -> ErrorArrays:
    """Take the numbers out of an error table, also out of one that was read back from a file."""
    columns = ("lon_error_m", "lat_error_m", "speed_error_mps", "lat_speed_error_mps")
    names = pd.factorize(errors["vehicle_id"])[0].astype(np.int64)
    episode = errors["episode"].to_numpy(dtype=np.int64)
    return ErrorArrays(
        vehicle=episode * (int(names.max(initial=0)) + 1) + names,
        absolute=np.abs(np.column_stack([errors[column].to_numpy(dtype=np.float64) for column in columns])),
        state=label_codes(errors["state"], VISIBILITY_STATES),
        seconds_hidden=errors["seconds_hidden"].to_numpy(dtype=np.float64),
        outcome=label_codes(errors["outcome"], OUTCOMES),
    )


def _is_stolen(rows: RunRows, matching: Matching, kept: IntArray, track_row: IntArray) -> BoolArray:
    """Return whether each kept row's track is matched to another vehicle and nearer to that one."""
    vehicles, tracks = rows.truth, rows.tracks
    stolen = np.zeros(len(kept), dtype=bool)
    other = np.where(track_row >= 0, matching.truth_row[track_row], -1) if len(tracks) else track_row
    suspect = np.flatnonzero((other >= 0) & (other != kept))
    own, thief, track = kept[suspect], other[suspect], track_row[suspect]

    def nearness(vehicle: IntArray) -> FloatArray:
        lon_m, lat_m = vehicles.lon_m[vehicle] - tracks.lon_m[track], vehicles.lat_m[vehicle] - tracks.lat_m[track]
        return similarity(*along_and_across(lon_m, lat_m, vehicles.direction_rad[vehicle]))

    stolen[suspect] = nearness(thief) > nearness(own)
    return stolen


def _of_track(values: FloatArray, track_row: IntArray) -> FloatArray:
    return np.append(values, np.nan)[track_row]


def _labels(codes: IntArray, names: tuple[str, ...]) -> pd.Categorical[str]:
    return pd.Categorical.from_codes(codes, categories=pd.Index(names))
