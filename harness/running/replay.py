"""Replays an earlier run's truth and detections exactly, without SUMO and without noise.

A ROS 2 bag (MCAP) of Autoware's messages is replayed likewise: its detections, and its ground truth or else its tracks.
"""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from harness.common.bounds import check_numbers
from harness.common.errors import InputError
from harness.common.isolation import isolated
from harness.common.named import named
from harness.config.model import RunConfig
from harness.config.sensor import SensorSettings
from harness.running.complete import check_scene, detection_table, truth_table
from harness.running.recorder import Columns, columns_of, detections_of, frame_of, rows_by_step
from harness.running.snapshots import SnapshotStream, timed_snapshots
from harness.sensor.detector import build_sensor, own_shadows
from harness.sensor.observation import Observation
from harness.sensor.profiles import sensor_settings
from harness.storage import run_folder as runfolder
from harness.storage.checks import check_truth, sound_tables
from harness.storage.manifest import tell_edited
from harness.storage.road_file import read_road
from harness.storage.schema import TABLES
from harness.truth.frame import Frame
from harness.truth.recorded.detected.recorded_drive import EGO
from harness.truth.recorded.logs import DETECTIONS, TRUTH, LogFile, topics
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map
from mmpf.map.road import Road
from mmpf.scan import Scan

PARAMETER = "replay"
RECORDED = (runfolder.TRUTH, runfolder.DETECTIONS, runfolder.ROAD)


def read_snapshots(folder: Path, config: RunConfig) -> SnapshotStream:
    """Read the truth and detections of a run folder."""
    with sound_tables(folder, PARAMETER):
        runfolder.read_manifest(folder, PARAMETER, ended=False)
        truth = runfolder.read_table(folder, runfolder.TRUTH, PARAMETER)
        detections = runfolder.read_table(folder, runfolder.DETECTIONS, PARAMETER)
        settings = sensor_settings(config.sensor.profile, config.sensor.overrides)
        road = read_road(folder / runfolder.ROAD, PARAMETER)
        check_truth(truth, road, f"`{PARAMETER}`: {folder / runfolder.TRUTH}")
        snapshots = snapshots_of(truth, detections, road, settings)
        tell_edited(folder, PARAMETER)
        return replace(snapshots, files={f"replay/{name}": folder / name for name in RECORDED})


def snapshots_of(truth: pd.DataFrame, detections: pd.DataFrame, road: Road, settings: SensorSettings) -> SnapshotStream:
    """Return the snapshots that tables of truth and detections record.

    Raises:
        ValueError: The tables hold what no vehicle or detection is.
    """
    _check_content(truth, detections)
    times = np.unique(truth["time_s"].to_numpy(dtype=np.float64))
    truth_at = rows_by_step(columns_of(truth, runfolder.TRUTH))
    found = columns_of(detections, runfolder.DETECTIONS)
    found_at, nothing = rows_by_step(found), {name: values[:0] for name, values in found.items()}

    def observe(frame: Frame) -> Observation:
        return _observation(frame, truth_at[frame.step], found_at.get(frame.step, nothing), road, settings)

    return SnapshotStream(
        road=road,
        step_s=float(np.round(np.diff(times).min(), 6)) if len(times) > 1 else 0.1,
        expected_steps=len(times),
        sensor=build_sensor(settings).model(road),
        stream=timed_snapshots(map(frame_of, truth_at.values()), observe),
    )


def _check_content(truth: pd.DataFrame, detections: pd.DataFrame) -> None:
    """Refuse by a ``ValueError`` a recording over which a tracker or a score would stumble later."""
    if not len(truth):
        raise ValueError("the truth contains no vehicle")
    for name, rows in ((runfolder.TRUTH, truth), (runfolder.DETECTIONS, detections)):
        check_numbers(name, rows, {column.name: column.numbers for column in TABLES[name].columns if column.numbers})
    egos = truth.groupby("step")["is_ego"].sum()
    if not (egos == 1).all():
        raise ValueError(f"step {egos.index[egos != 1][0]} has {egos[egos != 1].iloc[0]} egos")
    if truth.duplicated(["step", "vehicle_id"]).any():
        raise ValueError("a vehicle is twice in one step")
    times = truth.groupby("step")["time_s"].agg(["min", "max"]).to_numpy(dtype=np.float64)
    if (times[:, 0] != times[:, 1]).any() or (np.diff(times[:, 0]) <= 0.0).any():
        raise ValueError("the times of the steps do not ascend")


def _observation(frame: Frame, truth: Columns, seen: Columns, road: Road, settings: SensorSettings) -> Observation:
    """Return what was recorded of a frame; the sensor's shadows follow from its detections again."""
    detections, ego = detections_of(seen), frame.ego_pose
    place_of = {name: place for place, name in enumerate(truth["vehicle_id"].tolist())}
    return Observation(
        scan=Scan(frame.time_s, detections, ego, own_shadows(settings, detections, ego, road)),
        truth_id=seen["truth_id"],
        detection_visible_fraction=seen["visible_fraction"],
        visible_fraction=truth["visible_fraction"],
        in_range=truth["in_range"],
        state=truth["state"].astype(np.int8),
        occluder=np.array([place_of.get(name, -1) for name in truth["occluder_id"].tolist()], dtype=np.int64),
        behind_walls=truth.get("wall_fraction"),
        pseudo_hidden_s=truth.get("pseudo_hidden_s"),
    )


def snapshots_of_bag(path: Path, config: RunConfig) -> SnapshotStream:
    """Return what a bag has on record, in the plane of its frame ``map`` without lanes.

    What the sensor could see of each vehicle is worked out from the boxes, with the reach of the configured profile.

    Raises:
        InputError: The bag is broken, has no detections, no truth or no transform of the ego, or ends too early.
    """
    recording = config.traffic.recording
    assert recording is not None
    if recording.ego not in (EGO, "auto", "each"):
        raise InputError(f"`ego` {recording.ego}: a bag is seen from its own car; leave `ego` out")
    find, place = named(topics, "format", "mcap"), f"`replay`: {path} (autoware)"
    topic = {role: isolated(partial(find, path, role), place) for role in (TRUTH, DETECTIONS)}
    rows, found = (
        LogFile(Path(f"{path}:{name}"), role, "mcap").read().assign(episode=0) for role, name in topic.items()
    )
    if "is_ego" not in rows or not rows["is_ego"].any():
        raise InputError(f"`replay`: {path} has no transform of base_link, so where the ego is; record /tf too")
    check_scene(f"`replay`: {path}", rows)
    read = rows["id"].nunique()
    begin = rows["time_s"].min() + recording.start_s - 1e-6
    rows, found = (
        each[each["time_s"].between(begin, begin + config.traffic.duration_s, inclusive="left")].reset_index(drop=True)
        for each in (rows, found)
    )
    if not len(rows):
        raise InputError(f"`settings` traffic.recording.start_s: {path} ends before {recording.start_s:g} s; give less")
    road = LaneGraphRoad(graph=without_map())
    figures = sensor_settings(config.sensor.profile, config.sensor.overrides)
    try:
        truth, clock = truth_table(rows, road, figures)
        snapshots = snapshots_of(truth, detection_table(found, truth, clock), road, figures)
    except ValueError as error:
        raise InputError(f"`replay`: {path}: {error}; mend the file") from None
    report = f"truth: {topic[TRUTH]}; detections: {topic[DETECTIONS]}"
    vehicles = {"vehicles_read": read - 1, "vehicles_kept": rows["id"].nunique() - 1}
    about = {"recording": {"file": path.name, "format": recording.format, "ego": EGO, "egos": 1, **vehicles}}
    return replace(snapshots, files={f"replay/{path.name}": path}, report=report, about=about)
