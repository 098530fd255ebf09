"""Truth played back from a run's ``truth.parquet``."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from harness.truth.frame import EVERYWHERE, WINDOW_COLUMNS, Frame
from mmpf.road import Road

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = (
    "step",
    "time_s",
    "episode",
    "vehicle_id",
    "lon_m",
    "lat_m",
    "heading_rad",
    "speed_mps",
    "lat_speed_mps",
    "accel_mps2",
    "lane",
    "length_m",
    "width_m",
    "is_ego",
)
_PER_VEHICLE_FLOATS = (
    "lon_m",
    "lat_m",
    "heading_rad",
    "speed_mps",
    "lat_speed_mps",
    "accel_mps2",
    "length_m",
    "width_m",
)


class RecordedTruth:
    """Frames of a recorded run, in order.

    Attributes:
        road: The road that the run was driven on.
        step_s: Time between frames.
        expected_steps: How many frames there are.
    """

    def __init__(self, table: pd.DataFrame, road: Road) -> None:
        """Take the rows of ``truth.parquet``."""
        times = np.unique(table["time_s"].to_numpy(dtype=np.float64))
        self.road = road
        self.step_s = float(np.round(np.diff(times).min(), 6)) if len(times) > 1 else 0.1
        self.expected_steps = len(times)
        self._table = table

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order."""
        return frames_from_table(self._table)

    def close(self) -> None:
        """Do nothing: a table holds nothing open."""


def frames_from_table(table: pd.DataFrame) -> Iterator[Frame]:
    """Yield the frames of a table with the columns of ``truth.parquet``, vehicles in the table's order.

    A frame without a row that ``is_ego`` has ``ego`` -1.
    """
    if table.empty:
        return
    steps = table["step"].to_numpy(dtype=np.int64)
    order = np.argsort(steps, kind="stable")
    steps = steps[order]
    time = table["time_s"].to_numpy(dtype=np.float64)[order]
    episode = table["episode"].to_numpy(dtype=np.int64)[order]
    vehicle = table["vehicle_id"].to_numpy().astype(np.str_)[order]
    lane = table["lane"].to_numpy(dtype=np.int64)[order]
    is_ego = table["is_ego"].to_numpy(dtype=bool)[order]
    floats = {name: table[name].to_numpy(dtype=np.float64)[order] for name in _PER_VEHICLE_FLOATS}
    windows = [
        table[name].to_numpy(dtype=np.float64)[order] if name in table else np.full(len(order), everywhere)
        for name, everywhere in zip(WINDOW_COLUMNS, EVERYWHERE, strict=True)
    ]
    starts = np.flatnonzero(np.diff(steps, prepend=steps[0] - 1))
    for start, end in zip(starts, np.append(starts[1:], len(steps)), strict=True):
        rows = slice(int(start), int(end))
        egos = np.flatnonzero(is_ego[rows])
        yield Frame(
            step=int(steps[start]),
            time_s=float(time[start]),
            episode=int(episode[start]),
            ego=int(egos[0]) if len(egos) else -1,
            vehicle_id=vehicle[rows],
            lane=lane[rows],
            window_m=(float(windows[0][start]), float(windows[1][start])),
            **{name: values[rows] for name, values in floats.items()},
        )
