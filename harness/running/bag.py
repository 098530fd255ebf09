"""Replays a ROS 2 bag (MCAP) of Autoware's messages: its detections, and its ground truth or else its tracks."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from harness.common.errors import InputError
from harness.common.isolation import isolated
from harness.common.named import named
from harness.config.model import RunConfig
from harness.running.complete import detection_table, truth_table
from harness.running.replay import snapshots_of
from harness.running.snapshots import SnapshotStream
from harness.sensor.profiles import sensor_settings
from harness.truth.recorded.detected.recorded_drive import EGO
from harness.truth.recorded.logs import DETECTIONS, TRUTH, LogFile, topics
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map


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
    truth_topic, detections_topic = (isolated(partial(find, path, role), place) for role in (TRUTH, DETECTIONS))
    rows, found = (
        LogFile(Path(f"{path}:{topic}"), role, "mcap").read().assign(episode=0)
        for role, topic in ((TRUTH, truth_topic), (DETECTIONS, detections_topic))
    )
    if "is_ego" not in rows or not rows["is_ego"].any():
        raise InputError(f"`replay`: {path} has no transform of base_link, so where the ego is; record /tf too")
    read = rows["id"].nunique()
    begin = rows["time_s"].min() + recording.start_s - 1e-6
    rows, found = (
        each[each["time_s"].between(begin, begin + config.traffic.duration_s, inclusive="left")].reset_index(drop=True)
        for each in (rows, found)
    )
    if not len(rows):
        raise InputError(f"traffic.recording.start_s: {path} ends before {recording.start_s:g} s; start earlier")
    road = LaneGraphRoad(graph=without_map())
    figures = sensor_settings(config.sensor.profile, config.sensor.overrides)
    try:
        truth, clock = truth_table(rows, road, figures)
        snapshots = snapshots_of(truth, detection_table(found, truth, clock), road, figures)
    except ValueError as error:
        raise InputError(f"`replay`: {path}: {error}; mend the file") from None
    report = f"truth: {truth_topic}; detections: {detections_topic}"
    vehicles = {"vehicles_read": read - 1, "vehicles_kept": rows["id"].nunique() - 1}
    about = {"recording": {"file": path.name, "format": recording.format, "ego": EGO, "egos": 1, **vehicles}}
    return replace(snapshots, files={f"replay/{path.name}": path}, report=report, about=about)
