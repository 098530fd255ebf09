"""A finished run, loaded from its folder for figures and exports."""

import os
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import shapely

from harness.common.isolation import isolated
from harness.common.untrusted_files import check_file
from harness.config.layers import config_from_table
from harness.config.model import RunConfig
from harness.config.sensor import SensorSettings
from harness.running.resolve import check_sensor_of_folder
from harness.scoring.metrics.registry import quantities
from harness.sensor.profiles import sensor_settings
from harness.storage import run_folder as runfolder
from harness.storage.checks import check_truth
from harness.storage.road_file import read_road
from harness.storage.schema import TABLES
from harness.storage.tables import floats
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray

RAMP_HALF_WIDTH_M, SMALLEST_RAMP_M2, FAR_M = 1.83, 20.0, 1e5


@dataclass(frozen=True)
class RecordedRun:
    """Everything that a run folder says.

    Attributes:
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

    @property
    def is_log(self) -> bool:
        """Whether its tracks are a log's; folders that do not say so, of version 0.2.0, are told by their command."""
        return bool(self.manifest.get("is_log", self.manifest["command"].startswith("harness score")))

    @cached_property
    def reported(self) -> pd.DataFrame:
        """The tracks without tentative ones: those that scores are over, and every export but ``csv`` shows."""
        return self.tracks[(self.tracks["state"] != "tentative").to_numpy()].reset_index(drop=True)

    @cached_property
    def ramps(self) -> list[FloatArray]:
        """Return the ground beside the main lanes on which vehicles drive, such as ramps.

        Returns:
            Outlines in the road frame, each of shape (n, 2); none of a road without main lanes.
        """
        if not self.road.lanes:
            return []
        rows = self.truth[~self.road.on_a_lane(floats(self.truth, "lon_m"), floats(self.truth, "lat_m"))]
        rows = rows.sort_values(["vehicle_id", "step"], kind="stable")
        places, vehicle = rows[["lon_m", "lat_m"]].to_numpy(), rows["vehicle_id"].astype(object).to_numpy()
        cuts = np.flatnonzero((vehicle[1:] != vehicle[:-1]) | (np.diff(rows["step"].to_numpy()) > 1)) + 1
        paths = [shapely.LineString(path) for path in np.split(places, cuts) if len(path) > 1]
        ends = [np.clip((lane.start_m, lane.end_m), -FAR_M, FAR_M) for lane in self.road.lanes]
        main = [
            shapely.box(start, lane.right_m, end, lane.left_m)
            for (start, end), lane in zip(ends, self.road.lanes, strict=True)
        ]
        driven = shapely.simplify(shapely.union_all(shapely.buffer(paths, RAMP_HALF_WIDTH_M)), 0.1)
        beside = shapely.difference(driven, shapely.union_all(main))
        return [
            shapely.get_coordinates(part.exterior) for part in shapely.get_parts(beside) if part.area > SMALLEST_RAMP_M2
        ]

    def in_plane(self, table: pd.DataFrame) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return x, y and heading of a table's rows in the plane; what has no heading points along the road."""
        lon = floats(table, "lon_m")
        x, y = self.road.to_cartesian(lon, floats(table, "lat_m"))
        turn = floats(table, "heading_rad") if "heading_rad" in table else np.zeros(len(table))
        return x, y, self.road.heading_at(lon) + turn


def read_recorded_run(folder: Path, parameter: str = "folder", most_rows: int | None = None) -> RecordedRun:
    """Read a run folder.

    Args:
        most_rows: Rows of the truth after which no further stretch of a long run is read; None reads them all.

    Raises:
        InputError: It is no finished run's folder, or one of its files is missing, truncated or broken.
    """
    manifest = runfolder.read_manifest(folder, parameter)
    config = config_from_table(runfolder.read_config_table(folder, parameter))
    check_sensor_of_folder(config.sensor, folder, parameter)
    file, last_step = folder / runfolder.TRUTH, None
    if most_rows is not None:
        check_file(file, parameter)
        last_step = isolated(partial(_last_step, file, most_rows), f"`{parameter}`: {file}")

    def table(name: str) -> pd.DataFrame:
        step = "to_step" if "to_step" in TABLES[name].needed else "step"
        wanted = None if last_step is None else pc.field(step) <= last_step
        return runfolder.read_table(folder, name, parameter, wanted=wanted)

    def has(*names: str) -> bool:
        return all((folder / name).is_file() for name in names)

    # Both or none: a run that was made before drivers were asked has neither.
    asked = has(runfolder.BRAKINGS, runfolder.COMMANDS)
    road, truth = read_road(folder / runfolder.ROAD, parameter), table(runfolder.TRUTH)
    check_truth(truth, road, f"`{parameter}`: {file}")
    return RecordedRun(
        folder=folder,
        config=config,
        metrics=runfolder.read_metrics(folder, parameter),
        manifest=manifest,
        road=road,
        sensor=sensor_settings(config.sensor.profile, config.sensor.overrides),
        truth=truth,
        detections=table(runfolder.DETECTIONS),
        tracks=table(runfolder.TRACKS),
        errors=table(runfolder.ERRORS),
        events=table(runfolder.EVENTS),
        particles=table(runfolder.PARTICLES) if has(runfolder.PARTICLES) else None,
        brakings=table(runfolder.BRAKINGS) if asked else None,
        commands=table(runfolder.COMMANDS) if asked else None,
        unseen=table(runfolder.UNSEEN) if has(runfolder.UNSEEN) else None,
        whole=last_step is None,
    )


def _last_step(truth: Path, most_rows: int) -> int | None:
    """Return the last step of the stretches that are read; None if these are all, or if the table is no run's."""
    try:
        footer = pq.read_metadata(os.path.join(os.curdir, truth))
        step = footer.schema.names.index("step")
    except (OSError, pa.ArrowException, ValueError):
        return None
    rows = 0
    for group in range(footer.num_row_groups - 1):
        rows += footer.row_group(group).num_rows
        if (known := footer.row_group(group).column(step).statistics) is None or not known.has_min_max:
            return None
        if rows + footer.row_group(group + 1).num_rows > most_rows:
            return int(known.max)
    return None


def labels() -> dict[str, str]:
    """Return labels with units of numbers in ``metrics.json``, by their keys; a count has none, only its rate has."""
    return {each.key: each.label for each in quantities() if each.scale is None}
