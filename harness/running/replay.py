"""An earlier run's truth and detections, handed out again exactly as they were, without SUMO and without noise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import pandas as pd

from harness.config.model import RunConfig
from harness.runfolder import folder as runfolder
from harness.runfolder.road import read_road
from harness.runfolder.tables import DETECTION_NUMBERS, detections_of
from harness.running.open import RunInputs
from harness.sensor.detector import build_sensor
from harness.sensor.observation import VISIBILITY_STATES, Observation
from harness.sensor.profiles import SensorSettings, sensor_settings
from harness.sensor.shadows import free_space
from harness.truth.frame import EVERYWHERE, WINDOW_COLUMNS, Frame
from mmpf.compute.arrays import FloatArray
from mmpf.road import Road
from mmpf.scan import EgoPose, Scan, SensorModel

if TYPE_CHECKING:
    import pandas as pd


PARAMETER = "replay"
TRUTH_OBSERVATION = ("visible_fraction", "occluder_id", "in_range", "state")
RECORDED = (runfolder.TRUTH, runfolder.DETECTIONS, runfolder.ROAD)


def open_recording(folder: Path, config: RunConfig) -> RunInputs:
    """Open the truth and detections of a run folder.

    Args:
        folder: The run folder.
        config: Its sensor is the one that made the recording.

    Raises:
        InputError: The folder is no finished run, or one of its files is missing, truncated or broken.
    """
    runfolder.read_manifest(folder, PARAMETER)
    truth = runfolder.read_table(folder, runfolder.TRUTH, PARAMETER, (*COLUMNS, *TRUTH_OBSERVATION))
    detections = runfolder.read_table(
        folder, runfolder.DETECTIONS, PARAMETER, ("step", *DETECTION_NUMBERS, "visible_fraction", "truth_id")
    )
    settings = sensor_settings(config.sensor.profile, config.sensor.overrides)
    return RunInputs(
        truth=RecordedTruth(truth, read_road(folder / runfolder.ROAD, PARAMETER)),
        sensor=RecordedSensor(settings, _steps_of(truth), _steps_of(detections), detections.iloc[:0]),
        files={f"replay/{name}": folder / name for name in RECORDED},
    )


@dataclass(frozen=True)
class RecordedSensor:
    """Answers each frame with the observation that was recorded of it; draws no random number.

    Attributes:
        settings: Settings of the sensor that made the recording.
        truth: Rows of the truth table by step.
        detections: Rows of the detections table by step; steps without detections are absent.
        no_detections: The detections table without rows.
    """

    settings: SensorSettings
    truth: dict[int, pd.DataFrame]
    detections: dict[int, pd.DataFrame]
    no_detections: pd.DataFrame

    def model(self) -> SensorModel:
        """Return the data sheet of the recorded sensor."""
        return build_sensor(self.settings).model()

    def observe(self, frame: Frame, road: Road, rng: np.random.Generator) -> Observation:  # noqa: ARG002
        """Return the recorded observation of the frame; the sensor's shadows follow from its detections again."""
        truth = self.truth[frame.step]
        rows = self.detections.get(frame.step, self.no_detections)
        detections = detections_of(rows)
        ego = ego_pose(frame)
        view_rad = float(np.deg2rad(self.settings.field_of_view_deg))
        space = free_space(detections, ego, road, self.settings.range_m, view_rad)
        return Observation(
            scan=Scan(time_s=frame.time_s, detections=detections, ego=ego, free_space=space),
            truth_id=rows["truth_id"].to_numpy(dtype=str),
            detection_visible_fraction=_floats(rows, "visible_fraction"),
            visible_fraction=_floats(truth, "visible_fraction"),
            occluder=_index_of(truth["occluder_id"], truth["vehicle_id"]),
            in_range=truth["in_range"].to_numpy(dtype=bool),
            state=np.array([VISIBILITY_STATES.index(state) for state in truth["state"]], dtype=np.int8),
        )


def ego_pose(frame: Frame) -> EgoPose:
    """Return the pose of the frame's ego vehicle."""
    names = ("lon_m", "lat_m", "heading_rad", "speed_mps", "length_m", "width_m")
    return EgoPose(**{name: float(getattr(frame, name)[frame.ego]) for name in names})


def _steps_of(table: pd.DataFrame) -> dict[int, pd.DataFrame]:
    return {int(str(step)): rows for step, rows in table.groupby("step", sort=False)}


def _floats(rows: pd.DataFrame, name: str) -> FloatArray:
    return rows[name].to_numpy(dtype=np.float64)


def _index_of(names: pd.Series[str], among: pd.Series[str]) -> npt.NDArray[np.int64]:
    return pd.Index(among).get_indexer(pd.Index(names)).astype(np.int64)


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
