"""Boxes from an MCAP file's messages: Foxglove's scenes, and objects of ``autoware_perception_msgs``.

ROS is not needed. Speeds of objects are along their own heading, as in Autoware; objects that are told in a frame that
moves are put into the fixed one by the transform nearest in time.
"""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from struct import unpack
from typing import Any, BinaryIO
from zlib import crc32

import numpy as np
import pandas as pd
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory as ProtobufDecoders
from mcap_ros2.decoder import DecoderFactory as RosDecoders

from harness.storage.schema import REPORTED_STATES

SCENES = "foxglove.SceneUpdate"
OBJECTS = ("autoware_perception_msgs/msg/TrackedObjects", "autoware_perception_msgs/msg/DetectedObjects")
GROUND_TRUTH = "ground_truth"
TRANSFORMS = ("foxglove.FrameTransform", "tf2_msgs/msg/TFMessage")
EGO, EGO_FRAMES = "ego", ("base_link", "ego")
VEHICLE_LABELS = (0, 1, 2, 3, 4)
"""``ObjectClassification``: unknown, car, truck, bus, trailer."""
Pose = tuple[float, float, float]


def read_bag(path: Path, role: str, topic: str | None) -> pd.DataFrame:
    """Return the boxes of a topic, or with the role ``ego`` the ego's poses.

    Args:
        role: ``truth``, ``detections``, ``tracks`` or ``ego``.
        topic: The topic; None takes ``/role``, or the only one whose messages can be meant: of Autoware's, objects that
            are detected or tracked, of which those named ``ground_truth`` are the truth.

    Raises:
        ValueError: There is no such topic, or several that could be meant.
    """
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[ProtobufDecoders(), RosDecoders()])
        kinds = _kinds(reader.get_summary(), file)
        wanted = "" if role == EGO else _topic(kinds, role, topic)
        transforms = [name for name, kind in kinds.items() if kind in TRANSFORMS]
        ways: dict[str, list[tuple[float, *Pose]]] = {}
        boxes: list[dict[str, Any]] = []
        for schema, channel, message, decoded in reader.iter_decoded_messages(topics=[*transforms, wanted]):
            if schema is None:
                continue
            if channel.topic != wanted:
                for time_s, child, pose in _transforms(decoded, schema.name, message.log_time):
                    ways.setdefault(child, []).append((time_s, *pose))
            elif schema.name == SCENES:
                boxes += _of_scene(decoded, 1e-9 * message.log_time)
            else:
                boxes += _of_objects(decoded)
    own = next((np.array(ways[frame]) for frame in EGO_FRAMES if frame in ways), np.zeros((0, 4)))
    poses = pd.DataFrame(own, columns=["time_s", "lon_m", "lat_m", "heading_rad"])
    if role == EGO:
        return poses
    rows = pd.DataFrame(boxes, columns=None if boxes else ["time_s", "lon_m", "lat_m", "id", "frame"])
    rows = _fixed(rows, {name: np.array(way) for name, way in ways.items()})
    if role != "truth":
        rows = rows[~rows.pop("pedestrian").astype(bool)] if "pedestrian" in rows else rows
        return rows.drop(columns="is_ego", errors="ignore").reset_index(drop=True)
    if len(poses) and not ("is_ego" in rows and rows["is_ego"].any()):
        # The ego is wherever the boxes are told.
        at = rows["time_s"].unique()
        way = {name: np.interp(at, own[:, 0], np.unwrap(own[:, k]) if k == 3 else own[:, k])
               for k, name in enumerate(poses) if k}  # fmt: skip
        rows = pd.concat([rows.assign(is_ego=False), pd.DataFrame({"time_s": at, "id": EGO, "is_ego": True, **way})])
    return rows.reset_index(drop=True)


def topic_of(path: Path, role: str) -> str:
    """Return the topic that a bag has for ``truth``, ``detections`` or ``tracks``; see ``read_bag`` for errors."""
    with path.open("rb") as file:
        return _topic(_kinds(make_reader(file).get_summary(), file), role, None)


def _kinds(summary: Any, file: BinaryIO) -> dict[str, str]:  # noqa: ANN401
    """Return the schema's name of each topic."""
    if summary is None:
        raise ValueError("it has no summary: the recording was not ended")
    # Where the summary and its offsets begin, and its checksum, zero for none; a file ends with eight more bytes.
    file.seek(-28, os.SEEK_END)
    begin, _, checksum = unpack("<QQI", file.read(20))
    file.seek(begin)
    if checksum and checksum != crc32(file.read()[:-12]):
        raise ValueError("its summary is damaged")
    return {each.topic: summary.schemas[each.schema_id].name for each in summary.channels.values() if each.schema_id}


def _topic(kinds: Mapping[str, str], role: str, topic: str | None) -> str:
    usable = [name for name, kind in kinds.items() if kind == SCENES or kind in OBJECTS]
    tracked = [name for name in usable if kinds[name] == OBJECTS[0]]
    real = [name for name in tracked if GROUND_TRUTH in name]
    meant = {
        "truth": real or tracked,
        "detections": [name for name in usable if kinds[name] == OBJECTS[1]],
        "tracks": [name for name in tracked if name not in real],
    }[role]
    choices = next((found for found in ([f"/{role}"], meant, usable) if len(found) == 1 and found[0] in usable), [""])
    wanted = topic or choices[0]
    if wanted not in usable:
        told = (
            f"no boxes on {topic}" if topic else f"several topics with boxes and no /{role}" if usable else "no boxes"
        )
        raise ValueError(f"it has {told}; give FILE.mcap:/topic, there are {', '.join(usable) or 'none'}")
    return wanted


def _transforms(decoded: Any, kind: str, log_time: int) -> Iterator[tuple[float, str, Pose]]:  # noqa: ANN401
    if kind == TRANSFORMS[0]:
        place = decoded.translation.x, decoded.translation.y, _yaw(decoded.rotation)
        yield 1e-9 * log_time, decoded.child_frame_id, place
        return
    for each in decoded.transforms:
        shift = each.transform.translation
        yield _time_s(each.header.stamp), each.child_frame_id, (shift.x, shift.y, _yaw(each.transform.rotation))


def _of_scene(decoded: Any, time_s: float) -> Iterator[dict[str, Any]]:  # noqa: ANN401
    for entity in decoded.entities:
        if not entity.cubes:
            continue
        cube = entity.cubes[0]
        about = {pair.key: pair.value for pair in entity.metadata}
        numbers = ("speed_mps", "existence", "std_lon_m", "std_lat_m")
        yield _box(time_s, entity.frame_id, cube.pose, cube.size) | {
            "id": entity.id,
            "is_ego": about.get("state") == EGO,
            **({"state": about["state"]} if about.get("state") in REPORTED_STATES else {}),
            **{name: float(about[name]) for name in numbers if name in about},
        }


def _of_objects(decoded: Any) -> Iterator[dict[str, Any]]:  # noqa: ANN401
    time_s = _time_s(decoded.header.stamp)
    for each in decoded.objects:
        moves, likeliest = each.kinematics, max(each.classification, key=lambda c: c.probability, default=None)
        spread, own = moves.pose_with_covariance, moves.twist_with_covariance
        known = _box(time_s, decoded.header.frame_id, spread.pose, each.shape.dimensions)
        known |= {
            "existence": each.existence_probability,
            "pedestrian": likeliest is not None and likeliest.label not in VEHICLE_LABELS,
        }
        if getattr(moves, "has_twist", True):
            known |= {"speed_mps": own.twist.linear.x, "lat_speed_mps": own.twist.linear.y}
        deviations = {"std_lon_m": spread.covariance[0], "std_lat_m": spread.covariance[7]}
        deviations |= {"std_speed_mps": own.covariance[0]}
        known |= {name: float(np.sqrt(value)) for name, value in deviations.items() if value > 0.0}
        if hasattr(moves, "acceleration_with_covariance"):
            known["accel_mps2"] = moves.acceleration_with_covariance.accel.linear.x
        if hasattr(each, "object_id"):
            known["id"] = bytes(each.object_id.uuid).hex()
        yield known


def _box(time_s: float, frame: str, pose: Any, size: Any) -> dict[str, Any]:  # noqa: ANN401
    return {
        "time_s": time_s, "frame": frame, "lon_m": pose.position.x, "lat_m": pose.position.y,
        "heading_rad": _yaw(pose.orientation), "length_m": size.x, "width_m": size.y,
    }  # fmt: skip


def _fixed(rows: pd.DataFrame, ways: Mapping[str, np.ndarray[Any, np.dtype[np.float64]]]) -> pd.DataFrame:
    """Return boxes in the frame that no transform moves."""
    for frame, way in ways.items():
        own = (rows["frame"] == frame).to_numpy()
        if not own.any():
            continue
        at = way[np.abs(way[:, 0][None, :] - rows["time_s"].to_numpy()[own][:, None]).argmin(axis=1)]
        x, y = rows.loc[own, "lon_m"].to_numpy(), rows.loc[own, "lat_m"].to_numpy()
        cosine, sine = np.cos(at[:, 3]), np.sin(at[:, 3])
        rows.loc[own, "lon_m"] = at[:, 1] + x * cosine - y * sine
        rows.loc[own, "lat_m"] = at[:, 2] + x * sine + y * cosine
        rows.loc[own, "heading_rad"] = rows.loc[own, "heading_rad"] + at[:, 3]
    return rows.drop(columns="frame")


def _yaw(turn: Any) -> float:  # noqa: ANN401
    return float(np.arctan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2)))


def _time_s(stamp: Any) -> float:  # noqa: ANN401
    return float(stamp.sec + 1e-9 * stamp.nanosec)
