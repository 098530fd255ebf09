"""Collects a run's steps as columns and makes the tables of the run folder."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from harness.sensor.observation import Snapshot
from harness.storage.run_folder import DETECTIONS, TRACKS, TRUTH
from harness.storage.schema import TABLES, Column
from harness.truth.frame import EVERYWHERE, Frame
from mmpf.scan import BodyHeadings, BodySizes, Detections
from mmpf.tracks import Tracks

Columns = dict[str, npt.NDArray[Any]]
Rows = pd.DataFrame | Columns

TRACK_DECIMALS = 4
STRETCH_ROWS = 300_000
"""Rows of the truth after which a run's next episode begins a new stretch."""


@dataclass
class ColumnRecorder:
    """Keeps every step's columns; only whole steps are ever handed out.

    A stretch is one or more whole episodes; what depends on nothing but its episode can be made of it alone.

    Attributes:
        size_bytes: How much of each table is kept, by its file.
        end_stretch: Called between two episodes when at least ``stretch_rows`` rows of truth are kept; it takes the
            ``tables`` and lets the recorder ``forget`` them. None keeps the whole run.
    """

    steps: int = 0
    size_bytes: dict[str, int] = field(default_factory=lambda: dict.fromkeys((TRUTH, DETECTIONS, TRACKS), 0))
    end_stretch: Callable[[], None] | None = None
    stretch_rows: int = STRETCH_ROWS
    _forgotten: int = 0
    _rows: int = 0
    _episode: int | None = None
    _columns: dict[str, list[Columns]] = field(default_factory=lambda: {TRUTH: [], DETECTIONS: [], TRACKS: []})

    def add(self, snapshot: Snapshot, tracks: Tracks) -> None:
        """Record one step."""
        new_episode = self._episode is not None and snapshot.frame.episode != self._episode
        if self.end_stretch is not None and new_episode and self._rows >= self.stretch_rows:
            self.end_stretch()
        self._episode = snapshot.frame.episode
        new = (_truth_columns(snapshot), _detection_columns(snapshot), _track_columns(snapshot.frame, tracks))
        for (name, kept), columns in zip(self._columns.items(), new, strict=True):
            kept.append(columns)
            self.size_bytes[name] += sum(column.nbytes for column in columns.values())
        self._rows += len(snapshot.frame)
        self.steps += 1

    def tables(self) -> dict[str, pd.DataFrame]:
        """Return the tables that are kept, by file; an interrupt in the middle of a step leaves that step out."""
        whole = self.steps - self._forgotten
        return {name: _joined(columns[:whole]) for name, columns in self._columns.items()}

    def forget(self) -> None:
        """Free what is stored."""
        self._forgotten, self._rows = self.steps, 0
        self.size_bytes = dict.fromkeys(self.size_bytes, 0)
        for columns in self._columns.values():
            columns.clear()


def _truth_columns(snapshot: Snapshot) -> Columns:
    frame, observation = snapshot.frame, snapshot.observation
    is_ego = np.zeros(len(frame), dtype=bool)
    is_ego[frame.ego] = True
    start_m, end_m = frame.window_m if frame.window_m != EVERYWHERE else (None, None)
    walls = observation.behind_walls
    values = {
        "is_ego": is_ego,
        "visible_fraction": np.round(observation.visible_fraction, TRACK_DECIMALS),
        "occluder_id": np.append(frame.vehicle_id, "")[observation.occluder],
        "window_start_m": start_m,
        "window_end_m": end_m,
        "wall_fraction": None if walls is None else np.round(walls, TRACK_DECIMALS),
        "signals": frame.signals or None,
        # Only where they matter, so that other runs' tables are as they were.
        "vehicle_class": None if observation.scan.detections.vehicle_class is None else frame.vehicle_class,
    }
    return _columns(TRUTH, len(frame), {**vars(observation), **vars(frame), **values})


def columns_of(rows: Rows, name: str) -> Columns:
    """Return the columns of a table that its file's schema declares, each of shape (n,); words with codes as those."""
    if isinstance(rows, dict):
        return rows
    return {column.name: _values(rows, column) for column in TABLES[name].columns if column.name in rows}


def rows_by_step(columns: Columns) -> dict[int, Columns]:
    """Return each step's rows of columns, in order of the steps."""
    order = np.argsort(columns["step"], kind="stable")
    steps, first = np.unique(columns["step"][order], return_index=True)
    rows = zip(steps, np.split(order, first[1:]), strict=False)  # of no row there is one part
    return {int(step): {name: values[part] for name, values in columns.items()} for step, part in rows}


def frame_of(rows: Rows) -> Frame:
    """Return the frame that one step's rows of the truth table record; its ``ego`` is -1 where no row ``is_ego``."""
    columns = columns_of(rows, TRUTH)
    egos = np.flatnonzero(columns["is_ego"])
    first = {name: values[0] for name, values in columns.items()}
    of_step: dict[str, Any] = {
        "step": int(first["step"]),
        "time_s": float(first["time_s"]),
        "episode": int(first["episode"]),
        "ego": int(egos[0]) if len(egos) else -1,
        "window_m": (
            float(first.get("window_start_m", EVERYWHERE[0])),
            float(first.get("window_end_m", EVERYWHERE[1])),
        ),
        "signals": str(first.get("signals", "")),
    }
    return Frame(**{each.name: columns[each.name] for each in fields(Frame) if each.name in columns} | of_step)


def _detection_columns(snapshot: Snapshot) -> Columns:
    observation, detections = snapshot.observation, snapshot.observation.scan.detections
    values = {**when_of(snapshot.frame), **vars(detections)}
    if detections.sizes is not None:
        values |= vars(detections.sizes)
    if detections.headings is not None:
        values |= {**vars(detections.headings), "std_heading_rad": detections.headings.std_rad}
    values |= {
        "detection": np.arange(len(detections)),
        "visible_fraction": np.round(observation.detection_visible_fraction, TRACK_DECIMALS),
        "truth_id": observation.truth_id,
    }
    return _columns(DETECTIONS, len(detections), values)


def detections_of(rows: Rows) -> Detections:
    """Return the detections that rows of the table record, with sizes and directions where they were measured."""
    columns = columns_of(rows, DETECTIONS)

    def arrays(kind: type, **other_names: str) -> dict[str, Any]:
        names = {each.name: other_names.get(each.name, each.name) for each in fields(kind)}
        return {name: columns[column] for name, column in names.items() if column in columns}

    sizes, headings = arrays(BodySizes), arrays(BodyHeadings, std_rad="std_heading_rad")
    return Detections(
        **arrays(Detections),
        sizes=BodySizes(**sizes) if len(sizes) == len(fields(BodySizes)) else None,
        headings=BodyHeadings(**headings) if len(headings) == len(fields(BodyHeadings)) else None,
    )


def tracks_of(rows: pd.DataFrame) -> Tracks:
    """Return the tracks that rows of the table record."""
    columns = columns_of(rows, TRACKS)
    return Tracks(**{each.name: columns[each.name] for each in fields(Tracks)})


def _values(rows: pd.DataFrame, column: Column) -> npt.NDArray[Any]:
    if column.words:
        return np.asarray(pd.Index(column.words).get_indexer(pd.Index(rows[column.name])), dtype=np.int64)
    return rows[column.name].to_numpy(dtype=np.str_ if column.is_text else column.type)


def _track_columns(frame: Frame, tracks: Tracks) -> Columns:
    values = {name: np.round(values, TRACK_DECIMALS) for name, values in vars(tracks).items()}
    return _columns(TRACKS, len(tracks), {**when_of(frame), **values})


def when_of(frame: Frame) -> dict[str, Any]:
    """Return a frame's step, time and episode by the names of the tables' columns."""
    return {"step": frame.step, "time_s": frame.time_s, "episode": frame.episode}


def _columns(table: str, count: int, values: Mapping[str, Any]) -> Columns:
    """Return a table's columns: values by row, or one for all; codes of words as those, without what nobody knows."""
    columns: Columns = {}
    for column in TABLES[table].columns:
        value = values.get(column.name)
        if value is None and column.absent:
            continue
        if column.words:
            value = np.array(column.words, dtype=object)[value]
        columns[column.name] = np.full(count, value, dtype=object if column.is_text else column.type)
    return columns


def _joined(steps: list[Columns]) -> pd.DataFrame:
    if not steps:
        return pd.DataFrame()
    return pd.DataFrame({name: np.concatenate([step[name] for step in steps]) for name in steps[0]})
