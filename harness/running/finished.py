"""A finished run as its folder holds it, for whoever draws or exports it."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from harness.common.errors import InputError
from harness.common.untrusted_files import MOST_JSON_BYTES, MOST_TABLE_BYTES, check_file
from harness.config.layers import config_from_table
from harness.config.model import RunConfig
from harness.config.sensor import SensorSettings
from harness.running.resolve import check_sensor_of_folder
from harness.scoring.driving.brakings import FATES, KINDS
from harness.sensor.profiles import sensor_settings
from harness.storage import run_folder as runfolder
from harness.storage.checks import Until
from harness.storage.schema import DETECTION_NUMBERS, TRACK_NUMBERS, TRUTH_NUMBERS, VISIBILITY_STATES
from harness.storage.tables import floats
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray
from mmpf.tracks import TRACK_STATES

WHEN = ("step", "time_s", "episode")
ERROR_COLUMNS = (*WHEN, "vehicle_id", "state", "track_id", "lon_error_m", "lat_error_m", "speed_error_mps", "outcome")
PARTICLE_COLUMNS = ("step", "lon_m", "lat_m")
EVENT_COLUMNS = ("vehicle_id", "from_step", "to_step", "duration_s", "track_id", "outcome", "reacquire_s")
BRAKING_COLUMNS = (
    *("kind", "episode", "from_step", "to_step", "step", "duration_s", "truth_mps2", "tracks_mps2"),
    *("vehicle_id", "visibility", "unseen_s", "track_id", "fate"),
)
UNSEEN_COLUMNS = (*WHEN, "from_lon_m", "from_lat_m", "to_lon_m", "to_lat_m", "expected")
COMMAND_COLUMNS = (*WHEN, "truth_mps2", "tracks_mps2")


@dataclass(frozen=True)
class RecordedRun:
    """Everything that a run folder says.

    Attributes:
        folder: The folder.
        config: What was run.
        metrics: Content of ``metrics.json``.
        manifest: Content of ``manifest.json``.
        road: The lanes.
        sensor: Settings of the sensor.
        truth: One row per vehicle and step.
        detections: One row per detection.
        tracks: One row per track and step.
        errors: One row per vehicle that has been detected and step.
        events: One row per occlusion event.
        particles: A few particles of each step; None of a tracker without particles.
        brakings: One row per missed or phantom braking; None of a run that asked no driver.
        commands: One row per step: what the driver would do; likewise.
        unseen: At some steps a row per stretch of lane with the unseen vehicles expected there; None where nobody said.
        whole: Whether the tables hold the whole run; if not, they hold its beginning.
    """

    folder: Path
    config: RunConfig
    metrics: dict[str, Any]
    manifest: dict[str, Any]
    road: Road
    sensor: SensorSettings
    truth: pd.DataFrame
    detections: pd.DataFrame
    tracks: pd.DataFrame
    errors: pd.DataFrame
    events: pd.DataFrame
    particles: pd.DataFrame | None
    brakings: pd.DataFrame | None = None
    commands: pd.DataFrame | None = None
    unseen: pd.DataFrame | None = None
    whole: bool = True

    @property
    def step_s(self) -> float:
        """Time between two steps; 0.1 of a run of a single one."""
        times = self.truth["time_s"].unique()
        return float(np.median(np.diff(times))) if len(times) > 1 else 0.1

    def in_plane(self, table: pd.DataFrame) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return x, y and heading of a table's rows in the plane; what has no heading points along the road."""
        lon = floats(table, "lon_m")
        x, y = self.road.to_cartesian(lon, floats(table, "lat_m"))
        turn = floats(table, "heading_rad") if "heading_rad" in table else np.zeros(len(table))
        return x, y, self.road.heading_at(lon) + turn


def read_recorded_run(folder: Path, parameter: str = "folder", most_rows: int | None = None) -> RecordedRun:
    """Read a run folder.

    Args:
        folder: The folder.
        parameter: Parameter that named it, for the message.
        most_rows: Rows of the truth after which no further stretch of a long run is read; None reads them all.

    Raises:
        InputError: It is no finished run's folder, or one of its files is missing, truncated or broken.
    """
    manifest = runfolder.read_manifest(folder, parameter)
    config = config_from_table(runfolder.read_config_table(folder, parameter))
    check_sensor_of_folder(config.sensor, folder, parameter)

    last_step = None if most_rows is None else _last_step(folder / runfolder.TRUTH, parameter, most_rows)

    def table(name: str, columns: Collection[str], step: str = "step", states: Collection[str] = ()) -> pd.DataFrame:
        until = None if last_step is None else Until(step, last_step)
        rows = runfolder.read_table(folder, name, parameter, columns, until)
        unknown = sorted(set(map(str, rows["state"].unique())) - set(states)) if states else []
        if unknown:
            known = ", ".join(states)
            raise InputError(f"`{parameter}`: {folder / name} has a state {unknown[0][:40]!r}; there are {known}")
        return rows

    def decided(name: str, columns: Collection[str], step: str = "step") -> pd.DataFrame | None:
        # Both or none: a run that was made before drivers were asked has neither.
        there = all((folder / each).is_file() for each in (runfolder.BRAKINGS, runfolder.COMMANDS))
        if not there:
            return None
        rows = table(name, columns, step)
        for column, known in (("kind", KINDS), ("fate", FATES)):
            if column in rows and not rows[column].isin(known).all():
                raise InputError(f"`{parameter}`: {folder / name} has another {column} than {', '.join(known)}")
        return rows

    def sometimes(name: str, columns: Collection[str]) -> pd.DataFrame | None:
        return table(name, columns) if (folder / name).is_file() else None

    truth_columns = (*WHEN, "vehicle_id", *TRUTH_NUMBERS, "is_ego", "in_range", "visible_fraction", "state")
    return RecordedRun(
        folder=folder,
        config=config,
        metrics=read_metrics(folder, parameter),
        manifest=manifest,
        road=runfolder.read_road(folder / runfolder.ROAD, parameter),
        sensor=sensor_settings(config.sensor.profile, config.sensor.overrides),
        truth=table(runfolder.TRUTH, truth_columns, states=VISIBILITY_STATES),
        detections=table(runfolder.DETECTIONS, (*WHEN, *DETECTION_NUMBERS, "truth_id")),
        tracks=table(runfolder.TRACKS, (*WHEN, "track_id", *TRACK_NUMBERS, "state"), states=TRACK_STATES),
        errors=table(runfolder.ERRORS, ERROR_COLUMNS),
        events=table(runfolder.EVENTS, EVENT_COLUMNS, "to_step"),
        particles=sometimes(runfolder.PARTICLES, PARTICLE_COLUMNS),
        brakings=decided(runfolder.BRAKINGS, BRAKING_COLUMNS, "to_step"),
        commands=decided(runfolder.COMMANDS, COMMAND_COLUMNS),
        unseen=sometimes(runfolder.UNSEEN, UNSEEN_COLUMNS),
        whole=last_step is None,
    )


def _last_step(truth: Path, parameter: str, most_rows: int) -> int | None:
    """Return the last step of the stretches that are read; None if these are all, or if the table is no run's."""
    check_file(truth, MOST_TABLE_BYTES, parameter)
    try:
        footer = pq.read_metadata(truth)
        step = footer.schema.names.index("step")
    except (OSError, pa.ArrowException, ValueError):
        return None
    rows = 0
    for group in range(footer.num_row_groups - 1):
        rows += footer.row_group(group).num_rows
        known = footer.row_group(group).column(step).statistics
        if known is None or not known.has_min_max:
            return None
        if rows + footer.row_group(group + 1).num_rows > most_rows:
            return int(known.max)
    return None


def read_metrics(folder: Path, parameter: str) -> dict[str, Any]:
    """Return the content of a run's ``metrics.json``.

    Raises:
        InputError: It is missing or broken.
    """
    path = folder / runfolder.METRICS
    check_file(path, MOST_JSON_BYTES, parameter)
    try:
        metrics = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"`{parameter}`: {path} is missing or broken ({error}); make the run again") from None
    if not isinstance(metrics, dict):
        raise InputError(f"`{parameter}`: {path} is broken; make the run again")
    return metrics
