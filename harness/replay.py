"""An earlier run's truth and detections, handed out again exactly as they were, without SUMO and without noise."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from harness import runfolder
from harness.config import RunConfig
from harness.recorder import DETECTION_NUMBERS, detections_of
from harness.roadfile import read_road
from harness.runinputs import RunInputs
from harness.sensor.detector import build_sensor
from harness.sensor.observation import VISIBILITY_STATES, Observation
from harness.sensor.profiles import SensorSettings, sensor_settings
from harness.sensor.shadows import free_space
from harness.truth.frame import Frame
from harness.truth.recording import COLUMNS, RecordedTruth
from mmpf.road import FloatArray, Road
from mmpf.scan import EgoPose, Scan, SensorModel

OPTION = "--replay"
TRUTH_OBSERVATION = ("visible_fraction", "occluder_id", "in_range", "state")
RECORDED = (runfolder.TRUTH, runfolder.DETECTIONS, runfolder.ROAD)


def open_recording(folder: Path, config: RunConfig) -> RunInputs:
    """Open the truth and detections of a run folder.

    Args:
        folder: The run folder.
        config: Its sensor is the one that made the recording.

    Raises:
        UserError: The folder is no finished run, or one of its files is missing, truncated or broken.
    """
    runfolder.read_manifest(folder, OPTION)
    truth = runfolder.read_table(folder, runfolder.TRUTH, OPTION, (*COLUMNS, *TRUTH_OBSERVATION))
    detections = runfolder.read_table(
        folder, runfolder.DETECTIONS, OPTION, ("step", *DETECTION_NUMBERS, "visible_fraction", "truth_id")
    )
    settings = sensor_settings(config.sensor.profile, config.sensor.overrides)
    return RunInputs(
        truth=RecordedTruth(truth, read_road(folder / runfolder.ROAD, OPTION)),
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
