"""The tables of truth, detections and tracks of a run as arrays, read once."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
import pandas as pd

from harness.scoring.evidence.directions import nearest_row, read_directions
from harness.scoring.evidence.rules import GATE_LON_M
from harness.storage.schema import REPORTED_STATES, VISIBILITY_STATES
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class TruthRows:
    """Every vehicle but the ego at every step, sorted by vehicle and then by step; arrays of shape (n,).

    Attributes:
        step: Index of the step among the run's steps, from 0.
        vehicle: Code of the vehicle within its episode; the same name in another episode is another vehicle.
        name_row: Row of the truth table that this row comes from.
        in_range: Within the sensor's range, and not at or beyond the edge of what the source knows of the road.
        state: Index into ``harness.storage.schema.VISIBILITY_STATES``.
        detected: At least one detection came from the vehicle at this step.
        direction_rad: Direction against the longitudinal axis that its gates and errors are taken along; 0 on a road
            that has a frame of its own.
        accel_mps2: None where the table does not tell.
        parked: Whether the vehicle stands in one place for as long as it is on record; None where the source does not
            tell.
        pseudo_hidden_s: Length of the time for which it is hidden on purpose, 0 where it is not; None where none ever
            is.
    """

    step: IntArray
    time_s: FloatArray
    vehicle: IntArray
    name_row: IntArray
    lon_m: FloatArray
    lat_m: FloatArray
    speed_mps: FloatArray
    lat_speed_mps: FloatArray
    in_range: BoolArray
    state: IntArray
    detected: BoolArray
    direction_rad: FloatArray
    accel_mps2: FloatArray | None = None
    parked: BoolArray | None = None
    pseudo_hidden_s: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.step)


@dataclass(frozen=True)
class TrackRows:
    """Every reported track at every step, sorted by step; arrays of shape (m,).

    A tentative track is the tracker's private guess: it is not reported and so not scored. Whether the tracker takes a
    reported one for hidden is not here: that is its own word, and no score depends on it.

    Attributes:
        step: Index of the step among the run's steps.
        track: Code of the track within its episode, from 0; ``track_id`` is the tracker's own number.
        existence: Stated probability that it is a vehicle, nan where none is stated.
        unknowable: At or beyond the edge of what the source knows of the road, so that no vehicle there is on record.
        accel_mps2: None where the table does not tell.
    """

    step: IntArray
    track: IntArray
    track_id: IntArray
    lon_m: FloatArray
    lat_m: FloatArray
    speed_mps: FloatArray
    lat_speed_mps: FloatArray
    std_lon_m: FloatArray
    std_lat_m: FloatArray
    std_speed_mps: FloatArray
    existence: FloatArray
    unknowable: BoolArray
    accel_mps2: FloatArray | None = None

    def __len__(self) -> int:
        return len(self.step)


@dataclass(frozen=True)
class DetectionRows:
    """All detections as a tracker gets them, arrays of shape (d,).

    ``truth_row`` is the row of ``TruthRows`` that each came from, -1 for clutter; its gate lies along
    ``direction_rad``.
    """

    step: IntArray
    truth_row: IntArray
    lon_m: FloatArray
    lat_m: FloatArray
    direction_rad: FloatArray


@dataclass(frozen=True)
class RunRows:
    """A run as arrays.

    Attributes:
        step: Number of each step in the tables, shape (steps,).
        time_s: Time of each step, shape (steps,), as ``episode``.
        ego_row: Row of the truth table that is the ego at each step, -1 at a step without one, shape (steps,).
        ego_direction_rad: Direction of the ego at each step, as that of ``TruthRows``, nan at a step without one, shape
            (steps,).
        has_headings: Whether directions are those in which vehicles point, or all that of the road's own frame.
        hidden_by_wall: Whether walls hide more of each vehicle than other vehicles do, shape (n,) along ``truth``; None
            on a road without walls.
        on_roundabout: Whether each vehicle is on a roundabout, shape (n,) along ``truth``; None where none is known.
    """

    step: IntArray
    time_s: FloatArray
    episode: IntArray
    truth: TruthRows
    detections: DetectionRows
    tracks: TrackRows
    ego_row: IntArray
    ego_direction_rad: FloatArray
    has_headings: bool
    hidden_by_wall: BoolArray | None = None
    on_roundabout: BoolArray | None = None


def read_run(truth: pd.DataFrame, detections: pd.DataFrame, tracks: pd.DataFrame) -> RunRows:
    """Turn the three tables of a run, see ``harness.storage.schema``, into arrays.

    Without the column ``episode`` there is a single one. A vehicle or track counts as beyond the window's ends from
    the gate's length inside them on, since a vehicle just inside may have its track just outside.

    Raises:
        ValueError: A detection or track has a step that truth does not have, a truth state or track state is unknown, a
            detection or reported track has a position that is not finite, a direction is not finite, or a reported
            track is there twice at one step.
    """
    truth_step = _ints(truth, "step")
    steps, first_row, step_index = np.unique(truth_step, return_index=True, return_inverse=True)
    times = _floats(truth, "time_s")[first_row]
    all_episodes = _ints(truth, "episode") if "episode" in truth else np.zeros(len(truth), dtype=np.int64)
    episodes = all_episodes[first_row]
    name_codes, names = pd.factorize(truth["vehicle_id"])
    counts = ~truth["is_ego"].to_numpy(dtype=bool)
    if "pedestrian" in truth:
        counts &= ~truth["pedestrian"].to_numpy(dtype=bool)
    keep = np.flatnonzero(counts)
    vehicle = _codes(all_episodes[keep], name_codes[keep].astype(np.int64))
    order = np.lexsort((step_index[keep], vehicle))
    rows, vehicle = keep[order], vehicle[order]
    found = _all_detections(detections, steps, names, name_codes[rows].astype(np.int64), step_index[rows])
    direction, has_headings = read_directions(truth), "direction_rad" in truth
    if has_headings:
        places = step_index, _floats(truth, "lon_m"), _floats(truth, "lat_m")
        nearest = nearest_row(found.step, found.lon_m, found.lat_m, *places)
        found = replace(found, direction_rad=direction[nearest])
    ego = np.flatnonzero(truth["is_ego"].to_numpy(dtype=bool))
    ego_row = np.full(len(steps), -1)
    ego_row[step_index[ego]] = ego
    windows = _windows(truth, first_row)
    inside = _inside(_floats(truth, "lon_m"), windows, step_index)
    detected = np.zeros(len(rows), dtype=bool)
    detected[found.truth_row[found.truth_row >= 0]] = True
    return RunRows(
        step=steps,
        time_s=times,
        episode=episodes,
        truth=TruthRows(
            step=step_index[rows],
            time_s=times[step_index[rows]],
            vehicle=vehicle,
            name_row=rows,
            lon_m=_floats(truth, "lon_m")[rows],
            lat_m=_floats(truth, "lat_m")[rows],
            speed_mps=_floats(truth, "speed_mps")[rows],
            lat_speed_mps=_floats(truth, "lat_speed_mps")[rows],
            in_range=truth["in_range"].to_numpy(dtype=bool)[rows] & inside[rows],
            state=_state_codes(truth["state"], VISIBILITY_STATES)[rows],
            detected=detected,
            direction_rad=direction[rows],
            accel_mps2=_floats(truth, "accel_mps2")[rows] if "accel_mps2" in truth else None,
            parked=truth["parked"].to_numpy(dtype=bool)[rows] if "parked" in truth else None,
            pseudo_hidden_s=_floats(truth, "pseudo_hidden_s")[rows] if "pseudo_hidden_s" in truth else None,
        ),
        detections=found,
        tracks=_reported_tracks(tracks, steps, episodes, windows),
        ego_row=ego_row,
        ego_direction_rad=np.append(direction, np.nan)[ego_row],
        has_headings=has_headings,
        hidden_by_wall=_hidden_by_wall(truth, rows),
        on_roundabout=truth["on_roundabout"].to_numpy(dtype=bool)[rows] if "on_roundabout" in truth else None,
    )


def _hidden_by_wall(truth: pd.DataFrame, rows: IntArray) -> BoolArray | None:
    if "wall_fraction" not in truth:
        return None
    behind_walls, visible = _floats(truth, "wall_fraction")[rows], _floats(truth, "visible_fraction")[rows]
    return np.asarray(2.0 * behind_walls > 1.0 - visible)


def _windows(truth: pd.DataFrame, first_row: IntArray) -> FloatArray | None:
    """Return where the known road begins and ends at each step, shape (2, steps); None for everywhere."""
    if not {"window_start_m", "window_end_m"} <= set(truth):
        return None
    start_m, end_m = (_floats(truth, name)[first_row] for name in ("window_start_m", "window_end_m"))
    return np.stack([start_m + GATE_LON_M, end_m - GATE_LON_M])


def _inside(lon_m: FloatArray, windows: FloatArray | None, step: IntArray) -> BoolArray:
    if windows is None:
        return np.ones(len(lon_m), dtype=bool)
    return np.asarray((lon_m >= windows[0, step]) & (lon_m <= windows[1, step]))


def _reported_tracks(
    tracks: pd.DataFrame, steps: IntArray, episodes: IntArray, windows: FloatArray | None
) -> TrackRows:
    state = _state_codes(tracks["state"], REPORTED_STATES)
    rows = np.flatnonzero(state > 0)
    step = _step_index(_ints(tracks, "step")[rows], steps, "tracks")
    order = np.argsort(step, kind="stable")
    rows, step = rows[order], step[order]
    lon, lat = _floats(tracks, "lon_m")[rows], _floats(tracks, "lat_m")[rows]
    if not (np.isfinite(lon).all() and np.isfinite(lat).all()):
        raise ValueError("tracks: a reported track has a position that is not finite")
    track_id = _ints(tracks, "track_id")[rows]
    track = _codes(episodes[step], track_id)
    if len(np.unique(track * len(steps) + step)) < len(track):
        raise ValueError("tracks: a track is reported twice at one step")
    return TrackRows(
        step=step,
        track=track,
        track_id=track_id,
        lon_m=lon,
        lat_m=lat,
        speed_mps=_floats(tracks, "speed_mps")[rows],
        lat_speed_mps=_floats(tracks, "lat_speed_mps")[rows],
        std_lon_m=_floats(tracks, "std_lon_m")[rows],
        std_lat_m=_floats(tracks, "std_lat_m")[rows],
        std_speed_mps=_floats(tracks, "std_speed_mps")[rows],
        existence=_floats(tracks, "existence")[rows] if "existence" in tracks else np.full(len(rows), np.nan),
        unknowable=~_inside(lon, windows, step),
        accel_mps2=_floats(tracks, "accel_mps2")[rows] if "accel_mps2" in tracks else None,
    )


def _all_detections(
    detections: pd.DataFrame, steps: IntArray, names: pd.Index, row_name: IntArray, row_step: IntArray
) -> DetectionRows:
    step = _step_index(_ints(detections, "step"), steps, "detections")
    lon, lat = _floats(detections, "lon_m"), _floats(detections, "lat_m")
    if not (np.isfinite(lon).all() and np.isfinite(lat).all()):
        raise ValueError("detections: a detection has a position that is not finite")
    name = cast("IntArray", names.get_indexer(pd.Index(detections["truth_id"].astype("object"))).astype(np.int64))
    return DetectionRows(step, _origins(step, name, len(names), row_name, row_step), lon, lat, np.zeros(len(step)))


def _origins(step: IntArray, name: IntArray, names: int, row_name: IntArray, row_step: IntArray) -> IntArray:
    """Return the truth row that each detection came from, -1 for clutter, shape (d,); names are codes, -1 for none."""
    if not len(row_step):
        return np.full(len(step), -1)
    row_key = row_step * names + row_name
    by_key = np.argsort(row_key)
    key = step * names + name
    row = by_key[np.minimum(np.searchsorted(row_key[by_key], key), len(by_key) - 1)]
    return np.where((name >= 0) & (row_key[row] == key), row, -1)


def _codes(episode: IntArray, number: IntArray) -> IntArray:
    """Number the distinct pairs of episode and number from 0."""
    if not len(number):
        return np.zeros(0, dtype=np.int64)
    span = int(number.max() - number.min()) + 1
    return np.unique(episode * span + (number - number.min()), return_inverse=True)[1].astype(np.int64)


def _step_index(step: IntArray, steps: IntArray, table: str) -> IntArray:
    index = np.searchsorted(steps, step)
    known = index < len(steps)
    known[known] = steps[index[known]] == step[known]
    if not known.all():
        raise ValueError(f"{table}: step {step[~known][0]} is not in truth")
    return index.astype(np.int64)


def label_codes(labels: pd.Series[str], names: tuple[str, ...]) -> IntArray:
    """Return each label's place among the names, shape (n,); -1 of one that is none of them."""
    return pd.Index(names).get_indexer(pd.Index(labels)).astype(np.int64)


def _state_codes(states: pd.Series[str], names: tuple[str, ...]) -> IntArray:
    codes = label_codes(states, names)
    if (codes < 0).any():
        wrong = states[codes < 0].iloc[0]
        told = "a state is missing; it must be one" if pd.isna(wrong) else f"state {wrong!r} is none"
        raise ValueError(f"{told} of {', '.join(names)}")
    return codes


def _floats(table: pd.DataFrame, column: str) -> FloatArray:
    return table[column].to_numpy(dtype=np.float64, na_value=np.nan)


def _ints(table: pd.DataFrame, column: str) -> IntArray:
    return table[column].to_numpy(dtype=np.int64)
