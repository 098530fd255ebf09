"""Collects a run's steps as columns and turns them into the tables of the run folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import pandas as pd

from harness.sensor.observation import Look, Observation
from harness.storage.schema import (
    DETECTION_CORRELATION,
    DETECTION_HEADINGS,
    DETECTION_NUMBERS,
    DETECTION_SIZES,
    DIRECTION_COLUMN,
    PARKED_COLUMN,
    PEDESTRIAN_COLUMN,
    ROUNDABOUT_COLUMN,
    SIGNALS_COLUMN,
    TRACK_NUMBERS,
    TRUTH_NUMBERS,
    VISIBILITY_STATES,
    WALL_COLUMN,
    WINDOW_COLUMNS,
)
from harness.storage.tables import floats
from harness.truth.frame import EVERYWHERE, Frame
from mmpf.numerics.arrays import FloatArray
from mmpf.scan import BodyHeadings, BodySizes, Detections
from mmpf.tracks import TRACK_STATES, Tracks

Columns = dict[str, npt.NDArray[np.generic]]

TRACK_DECIMALS = 4
STRETCH_ROWS = 300_000
"""Rows of the truth after which a run's next episode begins a new stretch."""


@dataclass(frozen=True)
class RunTables:
    """The tables of a run.

    Attributes:
        truth: One row per vehicle and step.
        detections: One row per detection; ``truth_id`` is empty for clutter.
        tracks: One row per track and step.
    """

    truth: pd.DataFrame
    detections: pd.DataFrame
    tracks: pd.DataFrame


@dataclass
class ColumnRecorder:
    """Keeps every step's columns; only whole steps are ever handed out.

    A stretch is one or more whole episodes; what depends on nothing but its episode can be made of it alone.

    Attributes:
        steps: How many steps are recorded.
        end_stretch: Called between two episodes when at least ``stretch_rows`` rows of truth are kept; it takes the
            ``tables`` and lets the recorder ``forget`` them. None keeps the whole run.
        stretch_rows: See there.
    """

    steps: int = 0
    end_stretch: Callable[[], None] | None = None
    stretch_rows: int = STRETCH_ROWS
    _forgotten: int = 0
    _rows: int = 0
    _episode: int | None = None
    _truth: list[Columns] = field(default_factory=list)
    _detections: list[Columns] = field(default_factory=list)
    _tracks: list[Columns] = field(default_factory=list)

    def add(self, look: Look, tracks: Tracks) -> None:
        """Record one step."""
        new_episode = self._episode is not None and look.frame.episode != self._episode
        if self.end_stretch is not None and new_episode and self._rows >= self.stretch_rows:
            self.end_stretch()
        self._episode = look.frame.episode
        self._truth.append(_truth_columns(look))
        self._detections.append(_detection_columns(look))
        self._tracks.append(_track_columns(look.frame, tracks))
        self._rows += len(look.frame)
        self.steps += 1

    @property
    def kept(self) -> int:
        """How many steps were recorded since the last stretch ended."""
        return self.steps - self._forgotten

    def tables(self) -> RunTables:
        """Return what is kept; an interrupt in the middle of a step leaves that step out."""
        return RunTables(
            truth=_joined(self._truth[: self.kept]),
            detections=_joined(self._detections[: self.kept]),
            tracks=_joined(self._tracks[: self.kept]),
        )

    def forget(self) -> None:
        """Let go of what is kept."""
        self._forgotten, self._rows = self.steps, 0
        for columns in (self._truth, self._detections, self._tracks):
            columns.clear()


def _truth_columns(look: Look) -> Columns:
    frame, observation, count = look.frame, look.observation, len(look.frame)
    is_ego = np.zeros(count, dtype=bool)
    is_ego[frame.ego] = True
    occluder = np.append(frame.vehicle_id, "")[observation.occluder]
    return {
        **_when(frame, count),
        "vehicle_id": frame.vehicle_id.astype(object),
        **{name: getattr(frame, name) for name in TRUTH_NUMBERS},
        "is_ego": is_ego,
        "in_range": observation.in_range,
        "visible_fraction": np.round(observation.visible_fraction, TRACK_DECIMALS),
        "state": _named(VISIBILITY_STATES, observation.state),
        "occluder_id": occluder.astype(object),
        **_window_columns(frame, count),
        **({} if frame.direction_rad is None else {DIRECTION_COLUMN: frame.direction_rad}),
        **({} if frame.parked is None else {PARKED_COLUMN: frame.parked}),
        **({} if frame.pedestrian is None else {PEDESTRIAN_COLUMN: frame.pedestrian}),
        **({} if frame.on_roundabout is None else {ROUNDABOUT_COLUMN: frame.on_roundabout}),
        **_wall_columns(observation),
        **({SIGNALS_COLUMN: np.full(count, frame.signals, dtype=object)} if frame.signals else {}),
    }


def _wall_columns(observation: Observation) -> Columns:
    """Return how much of each vehicle walls hide, if there are walls."""
    if observation.behind_walls is None:
        return {}
    return {WALL_COLUMN: np.round(observation.behind_walls, TRACK_DECIMALS)}


def frame_of(rows: pd.DataFrame) -> Frame:
    """Return the frame that one step's rows of the truth table record; its ``ego`` is -1 where no row ``is_ego``."""
    egos = np.flatnonzero(rows["is_ego"].to_numpy(dtype=bool))
    first = rows.iloc[0]
    return Frame(
        step=int(first["step"]),
        time_s=float(first["time_s"]),
        episode=int(first["episode"]),
        ego=int(egos[0]) if len(egos) else -1,
        vehicle_id=rows["vehicle_id"].to_numpy().astype(np.str_),
        lane=rows["lane"].to_numpy(dtype=np.int64),
        window_m=(
            float(first.get(WINDOW_COLUMNS[0], EVERYWHERE[0])),
            float(first.get(WINDOW_COLUMNS[1], EVERYWHERE[1])),
        ),
        direction_rad=floats(rows, DIRECTION_COLUMN) if DIRECTION_COLUMN in rows else None,
        parked=rows[PARKED_COLUMN].to_numpy(dtype=bool) if PARKED_COLUMN in rows else None,
        pedestrian=rows[PEDESTRIAN_COLUMN].to_numpy(dtype=bool) if PEDESTRIAN_COLUMN in rows else None,
        on_roundabout=rows[ROUNDABOUT_COLUMN].to_numpy(dtype=bool) if ROUNDABOUT_COLUMN in rows else None,
        signals=str(first.get(SIGNALS_COLUMN, "")),
        **{name: rows[name].to_numpy(dtype=np.float64) for name in TRUTH_NUMBERS if name != "lane"},
    )


def _window_columns(frame: Frame, count: int) -> Columns:
    """Return where the record of the road begins and ends, if it does."""
    if frame.window_m == EVERYWHERE:
        return {}
    return {name: np.full(count, edge_m) for name, edge_m in zip(WINDOW_COLUMNS, frame.window_m, strict=True)}


def _detection_columns(look: Look) -> Columns:
    observation, detections = look.observation, look.observation.scan.detections
    return {
        **_when(look.frame, len(detections)),
        "detection": np.arange(len(detections)),
        **{name: getattr(detections, name) for name in DETECTION_NUMBERS},
        **_size_columns(detections),
        **_heading_columns(detections),
        **({} if detections.correlation is None else {DETECTION_CORRELATION: detections.correlation}),
        "visible_fraction": np.round(observation.detection_visible_fraction, TRACK_DECIMALS),
        "truth_id": observation.truth_id.astype(object),
    }


def _size_columns(detections: Detections) -> Columns:
    """Return the measured sizes, if the sensor measures any."""
    if detections.sizes is None:
        return {}
    return {name: getattr(detections.sizes, name) for name in DETECTION_SIZES}


def _heading_columns(detections: Detections) -> Columns:
    """Return the measured directions, if the sensor measures any."""
    headings = detections.headings
    if headings is None:
        return {}
    columns = headings.heading_rad, headings.std_rad, headings.flip_probability
    return dict(zip(DETECTION_HEADINGS, columns, strict=True))


def detections_of(rows: pd.DataFrame) -> Detections:
    """Return the detections that rows of the table record, with sizes and directions where they were measured."""

    def columns(names: tuple[str, ...]) -> list[FloatArray]:
        return [floats(rows, name) for name in names]

    lon, lat, speed, std_lon, std_lat, std_speed = columns(DETECTION_NUMBERS)
    sizes = BodySizes(*columns(DETECTION_SIZES)) if set(DETECTION_SIZES) <= set(rows.columns) else None
    has_headings = set(DETECTION_HEADINGS) <= set(rows.columns)
    headings = BodyHeadings(*columns(DETECTION_HEADINGS)) if has_headings else None
    correlation = floats(rows, DETECTION_CORRELATION) if DETECTION_CORRELATION in rows else None
    return Detections(lon, lat, speed, std_lon, std_lat, std_speed, sizes, headings, correlation)


def _track_columns(frame: Frame, tracks: Tracks) -> Columns:
    return {
        **_when(frame, len(tracks)),
        "track_id": tracks.track_id,
        **{name: np.round(getattr(tracks, name), TRACK_DECIMALS) for name in TRACK_NUMBERS},
        "state": _named(TRACK_STATES, tracks.state),
    }


def _when(frame: Frame, count: int) -> Columns:
    return {
        "step": np.full(count, frame.step),
        "time_s": np.full(count, frame.time_s),
        "episode": np.full(count, frame.episode),
    }


def _named(names: tuple[str, ...], codes: npt.NDArray[np.int8]) -> npt.NDArray[np.object_]:
    return np.array(names, dtype=object)[codes]


def _joined(steps: list[Columns]) -> pd.DataFrame:
    if not steps:
        return pd.DataFrame()
    return pd.DataFrame({name: np.concatenate([step[name] for step in steps]) for name in steps[0]})
