"""A run as an MCAP bag of ROS 2 with Autoware's messages: detections, tracks, the ego's transform and the clock.

ROS is not needed: ``mcap-ros2-support`` encodes the messages as CDR. Positions are in metres in the frame ``map``, the
plane of the network; speeds and accelerations are along an object's own heading and across it, as in Autoware. The
truth is on a topic of its own, on which no tracker listens.
"""

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from mcap_ros2.writer import Writer

from harness.export.sizes import SIZE, detection_sizes, track_sizes
from harness.running.finished import RecordedRun
from harness.storage.tables import floats, rows_of_steps
from mmpf.numerics.arrays import FloatArray, IntArray, turned

FILE, MAP, EGO = "autoware.mcap", "map", "base_link"
PACKAGE = "autoware_perception_msgs"
DETECTED, TRACKED = f"{PACKAGE}/DetectedObjects", f"{PACKAGE}/TrackedObjects"
TOPICS = {
    "/clock": "rosgraph_msgs/Clock",
    "/tf": "tf2_msgs/TFMessage",
    "/perception/object_recognition/detection/objects": DETECTED,
    "/perception/object_recognition/tracking/objects": TRACKED,
    "/perception/object_recognition/ground_truth/objects": TRACKED,
}
CAR, HEIGHT_M, STILL_MPS, NANOSECONDS = 1, 1.5, 0.5, 1_000_000_000
UNAVAILABLE, AVAILABLE = 0, 2

Message = dict[str, Any]


def export(run: RecordedRun, folder: Path) -> list[Path]:
    """Write ``autoware.mcap``, whose topics are ``TOPICS``, into the folder and return it."""
    clock, tf, *objects = TOPICS
    ego = run.truth[run.truth["is_ego"].to_numpy(dtype=bool)]
    poses = dict(zip(ego["step"].tolist(), np.column_stack(run.in_plane(ego)).tolist(), strict=True))
    others = run.truth[~run.truth["is_ego"].to_numpy(dtype=bool)]
    whose = [run.reported[name].to_numpy(dtype=np.int64) for name in ("episode", "track_id")]
    # In the plane the tables do not say which way a track heads.
    orientation = UNAVAILABLE if run.road.has_headings else AVAILABLE
    tracked = _objects(run, run.reported, np.column_stack(whose), track_sizes(run, *whose), orientation)
    boxes = (
        _by_step(run.detections, _detected(run)),
        _by_step(run.reported, tracked),
        _by_step(others, _of_truth(run, others)),
    )
    path = folder / FILE
    with path.open("wb") as file:
        writer: Any = Writer(file)
        schemas = {
            name: writer.register_msgdef(name.replace("/", "/msg/"), definition(name)) for name in TOPICS.values()
        }
        times = run.truth.drop_duplicates("step")[["step", "time_s"]].sort_values("step")
        for step, time_s in times.to_numpy().tolist():
            time_ns = round(time_s * NANOSECONDS)
            stamp = dict(zip(("sec", "nanosec"), divmod(time_ns, NANOSECONDS), strict=True))
            header = {"stamp": stamp, "frame_id": MAP}
            messages: dict[str, Message] = {clock: {"clock": stamp}}
            if step in poses:
                x, y, heading = poses[step]
                moved = {"translation": _vector(x, y), "rotation": _turn(heading)}
                messages[tf] = {"transforms": [{"header": header, "child_frame_id": EGO, "transform": moved}]}
            for topic, found in zip(objects, boxes, strict=True):
                messages[topic] = {"header": header, "objects": found.get(int(step), [])}
            for topic, message in messages.items():
                writer.write_message(topic, schemas[TOPICS[topic]], message, time_ns, time_ns)
        writer.finish()
    return [path]


@cache
def _definitions() -> dict[str, str]:
    text = files("harness.export").joinpath("autoware_messages.txt").read_text(encoding="utf-8")
    parts = (part.partition("\n") for part in text.split("MSG: ")[1:])
    return {name: body for name, _, body in parts}


def definition(name: str) -> str:
    """Return a message's definition with those that it uses, as bags hold it."""
    needed, sections = [name], _definitions()
    for each in needed:  # grows while it is gone through
        for word in re.findall(r"^([A-Za-z_0-9]+(?:/\w+)?)(?:\[\d*\])? \w+", sections[each], re.MULTILINE):
            full = word if "/" in word else f"{each.partition('/')[0]}/{word}"
            if full in sections and full not in needed:
                needed.append(full)
    rule = "=" * 80
    return sections[name] + "".join(f"{rule}\nMSG: {each}\n{sections[each]}" for each in needed[1:])


def _detected(run: RecordedRun) -> list[Message]:
    found = run.detections
    size = detection_sizes(found)
    speed, has_heading = _column(found, "speed_mps", np.nan), np.isfinite(_column(found, "heading_rad", np.nan))
    deviations = np.column_stack([floats(found, name) for name in ("std_lon_m", "std_lat_m")])
    along = _column(found, "std_speed_mps", np.nan)
    x, y, heading = run.in_plane(found)
    heading = np.where(np.isfinite(heading), heading, 0.0)
    along_road = run.road.heading_at(floats(found, "lon_m"))
    return [
        {
            "existence_probability": 1.0,
            **_body(size[k]),
            "kinematics": {
                "pose_with_covariance": _pose(x[k], y[k], heading[k], deviations[k], along_road[k]),
                "has_position_covariance": True,
                "orientation_availability": AVAILABLE if has_heading[k] else UNAVAILABLE,
                "twist_with_covariance": _rates("twist", (speed[k], 0.0), (along[k], 0.0)),
                "has_twist": bool(np.isfinite(speed[k])),
                "has_twist_covariance": bool(np.isfinite(along[k])),
            },
        }
        for k in range(len(found))
    ]


def _of_truth(run: RecordedRun, others: pd.DataFrame) -> list[Message]:
    number = np.unique(others["vehicle_id"].to_numpy(dtype=np.str_), return_inverse=True)[1]
    turn, along, across = (floats(others, name) for name in ("heading_rad", "speed_mps", "lat_speed_mps"))
    # The tables tell rates along the road, or along each vehicle where there is no single one.
    along, across = turned(along, across, turn - run.road.axis_of(turn))
    others = others.assign(speed_mps=along, lat_speed_mps=across)
    return _objects(run, others, np.column_stack([0 * number, number]), others[SIZE].to_numpy(float), AVAILABLE)


def _objects(
    run: RecordedRun, rows: pd.DataFrame, identity: IntArray, size: FloatArray, orientation: int
) -> list[Message]:
    """Return rows of tracks or of the truth as objects with an identity of two numbers, shape (n, 2)."""
    speed, lat_speed, accel = (floats(rows, name) for name in ("speed_mps", "lat_speed_mps", "accel_mps2"))
    deviations = np.column_stack([_column(rows, name, 0.0) for name in ("std_lon_m", "std_lat_m")])
    along, existence = _column(rows, "std_speed_mps", 0.0), _column(rows, "existence", 1.0)
    x, y, heading = run.in_plane(rows)
    along_road = run.road.heading_at(floats(rows, "lon_m"))
    return [
        {
            "object_id": {"uuid": [byte for part in identity[k].tolist() for byte in part.to_bytes(8, signed=True)]},
            "existence_probability": existence[k],
            **_body(size[k]),
            "kinematics": {
                "pose_with_covariance": _pose(x[k], y[k], heading[k], deviations[k], along_road[k]),
                "twist_with_covariance": _rates("twist", (speed[k], lat_speed[k]), (along[k], 0.0)),
                "acceleration_with_covariance": _rates("accel", (accel[k], 0.0), (0.0, 0.0)),
                "orientation_availability": orientation,
                "is_stationary": bool(np.hypot(speed[k], lat_speed[k]) < STILL_MPS),
            },
        }
        for k in range(len(rows))
    ]


def _by_step(table: pd.DataFrame, messages: list[Message]) -> Mapping[int, list[Message]]:
    return {step: messages[rows] for step, rows in rows_of_steps(table).items()}


def _column(table: pd.DataFrame, name: str, usual: float) -> FloatArray:
    return floats(table, name) if name in table else np.full(len(table), usual)


def _body(size_m: FloatArray) -> Message:
    length, width = size_m.tolist()
    box = {"type": 0, "dimensions": {"x": length, "y": width, "z": HEIGHT_M}}
    return {"classification": [{"label": CAR, "probability": 1.0}], "shape": box}


def _vector(x: float, y: float) -> Message:
    return {"x": float(x), "y": float(y), "z": 0.0}


def _turn(heading: float) -> Message:
    return {"x": 0.0, "y": 0.0, "z": float(np.sin(0.5 * heading)), "w": float(np.cos(0.5 * heading))}


def _pose(x: float, y: float, heading: float, std_m: FloatArray, along_road: float) -> Message:
    """Return a pose with the covariance of x and y, of deviations along and across the road's direction."""
    cosine, sine = np.cos(along_road), np.sin(along_road)
    turn = np.array([[cosine, -sine], [sine, cosine]])
    covariance = np.zeros((6, 6))
    covariance[:2, :2] = turn @ np.diag(std_m**2) @ turn.T
    return {
        "pose": {"position": _vector(x, y), "orientation": _turn(heading)},
        "covariance": covariance.ravel().tolist(),
    }


def _rates(kind: str, linear: tuple[float, float], std: tuple[float, float]) -> Message:
    covariance = np.zeros(36)
    covariance[[0, 7]] = np.nan_to_num(np.square(std))
    return {kind: {"linear": _vector(*np.nan_to_num(linear))}, "covariance": covariance.tolist()}
