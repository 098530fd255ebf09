"""A run as an MCAP recording in Foxglove's schemas: scenes of truth, detections and tracks, and curves.

Positions are in the frame ``map``, the plane of the network; the frame ``ego`` moves with the ego, in the middle of its
box. Time counts from the run's begin. Everything in a scene lives until the next step's.
"""

import json
from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.writer import Writer
from mcap_protobuf.schema import register_schema

from harness.common.palette import DETECTION_COLOUR, EGO_COLOUR, LANE_COLOUR, PURPLE, STATE_COLOURS
from harness.export.curves import curves_of
from harness.export.lanes import lanes_of
from harness.export.sizes import SIZE, detection_sizes, track_sizes
from harness.running.finished import RecordedRun
from harness.storage.tables import floats
from mmpf.numerics.arrays import FloatArray

FILE = "run.mcap"
MAP, EGO = "map", "ego"
LIBRARY = "mmpf-harness"
HEIGHT_M, TEXT_M, LINE_M = 1.5, 1.2, 0.15
NANOSECONDS = 1_000_000_000
CURVES, CURVES_SCHEMA = "/curves", "harness.Curves"

About = Mapping[str, str]


@dataclass(frozen=True)
class _Boxes:
    """Boxes of one kind at all steps, struct of arrays of shape (n,); ``place`` is middle and heading, (n, 3)."""

    rows: Mapping[Hashable, Iterable[int]]
    place: FloatArray
    size_m: FloatArray
    name: Sequence[str]
    colour: Sequence[str]
    about: Callable[[int], About]
    alpha: float = 1.0
    label: bool = False


@dataclass
class _Recording:
    """An MCAP file that is being written, with its channels as they come up."""

    writer: Any
    channels: dict[str, int] = field(default_factory=dict)

    def put(self, topic: str, time_ns: int, message: Any) -> None:  # noqa: ANN401  messages share no type
        """Write a message of Foxglove's."""
        if topic not in self.channels:
            schema = register_schema(self.writer, type(message))
            self.channels[topic] = self.writer.register_channel(topic, "protobuf", schema)
        self._add(topic, time_ns, message.SerializeToString(deterministic=True))

    def put_curves(self, time_ns: int, numbers: Mapping[str, float]) -> None:
        """Write named numbers, as JSON; the names are the same every time."""
        if CURVES not in self.channels:
            schema = {"type": "object", "properties": {name: {"type": "number"} for name in numbers}}
            described = json.dumps(schema).encode()
            number = self.writer.register_schema(name=CURVES_SCHEMA, encoding="jsonschema", data=described)
            self.channels[CURVES] = self.writer.register_channel(CURVES, "json", number)
        known = {name: round(value, 4) for name, value in numbers.items() if np.isfinite(value)}
        self._add(CURVES, time_ns, json.dumps(known).encode())

    def _add(self, topic: str, time_ns: int, content: bytes) -> None:
        self.writer.add_message(self.channels[topic], log_time=time_ns, data=content, publish_time=time_ns)


def export(run: RecordedRun, folder: Path) -> list[Path]:
    """Write ``run.mcap``: topics ``/road``, ``/truth``, ``/detections``, ``/tracks``, ``/tf`` and ``/curves``."""
    path = folder / FILE
    with path.open("wb") as file:
        writer: Any = Writer(file)
        writer.start(profile="", library=LIBRARY)
        writer.add_metadata("run", {"title": run.config.title(), "seed": str(run.config.seed)})
        _write(run, _Recording(writer))
        writer.finish()
    return [path]


def _write(run: RecordedRun, recording: _Recording) -> None:
    curves = curves_of(run)
    steps = np.unique(run.truth["step"].to_numpy())
    kinds = {"/truth": _truth(run), "/detections": _detections(run), "/tracks": _tracks(run)}
    egos = run.truth[run.truth["is_ego"].to_numpy(dtype=bool)]
    ego_at = dict(zip(egos["step"].tolist(), np.column_stack(run.in_plane(egos)).tolist(), strict=True))
    numbers = {f"error_{name}_m": values for name, values in curves.error_m.items()}
    numbers |= {name.replace(" ", "_"): values for name, values in curves.count.items()}
    for k, (step, time_s) in enumerate(zip(steps.tolist(), curves.time_s.tolist(), strict=True)):
        time_ns = round(time_s * NANOSECONDS)
        if k == 0:
            recording.put("/road", time_ns, _road(run, time_ns))
        if step in ego_at:
            (x, y, heading), transform = ego_at[step], FrameTransform(parent_frame_id=MAP, child_frame_id=EGO)
            _stamp(transform.timestamp, time_ns)
            transform.translation.x, transform.translation.y = x, y
            transform.rotation.z, transform.rotation.w = np.sin(0.5 * heading), np.cos(0.5 * heading)
            recording.put("/tf", time_ns, transform)
        for topic, boxes in kinds.items():
            recording.put(topic, time_ns, _scene(boxes, step, time_ns, round(run.step_s * NANOSECONDS)))
        recording.put_curves(time_ns, {name: float(values[k]) for name, values in numbers.items()})


def _truth(run: RecordedRun) -> _Boxes:
    truth = run.truth
    is_ego = truth["is_ego"].to_numpy(dtype=bool)
    states, speed = truth["state"].tolist(), floats(truth, "speed_mps")
    visible = floats(truth, "visible_fraction")
    return _Boxes(
        rows=truth.groupby("step").indices,
        place=np.column_stack(run.in_plane(truth)),
        size_m=truth[SIZE].to_numpy(dtype=np.float64),
        name=truth["vehicle_id"].astype(str).tolist(),
        colour=[EGO_COLOUR if ego else STATE_COLOURS[state] for ego, state in zip(is_ego, states, strict=True)],
        about=lambda row: {
            "state": "ego" if is_ego[row] else states[row],
            "speed_mps": f"{speed[row]:.2f}",
            "visible_fraction": f"{visible[row]:.3f}",
        },
    )


def _detections(run: RecordedRun) -> _Boxes:
    found = run.detections
    truth_id = found["truth_id"].tolist()
    place_in_scan = found.groupby("step").cumcount()
    return _Boxes(
        rows=found.groupby("step").indices,
        place=np.column_stack(run.in_plane(found)),
        size_m=detection_sizes(found),
        name=[f"detection {number}" for number in place_in_scan.tolist()],
        colour=[DETECTION_COLOUR] * len(found),
        about=lambda row: {"truth_id": str(truth_id[row]) or "clutter"},
        alpha=0.5,
    )


def _tracks(run: RecordedRun) -> _Boxes:
    tracks = run.reported
    states = tracks["state"].tolist()
    spread = tracks[["existence", "std_lon_m", "std_lat_m"]].to_numpy(dtype=np.float64)
    return _Boxes(
        rows=tracks.groupby("step").indices,
        place=np.column_stack(run.in_plane(tracks)),
        size_m=track_sizes(run, *(tracks[name].to_numpy() for name in ("episode", "track_id"))),
        name=[str(number) for number in tracks["track_id"].tolist()],
        colour=[PURPLE] * len(tracks),
        about=lambda row: {
            "state": states[row],
            "existence": f"{spread[row, 0]:.3f}",
            "std_lon_m": f"{spread[row, 1]:.2f}",
            "std_lat_m": f"{spread[row, 2]:.2f}",
        },
        alpha=0.4,
        label=True,
    )


def _scene(boxes: _Boxes, step: int, time_ns: int, lifetime_ns: int) -> SceneUpdate:
    scene = SceneUpdate()
    for row in boxes.rows.get(step, ()):
        entity = scene.entities.add(frame_id=MAP, id=boxes.name[row])
        _stamp(entity.timestamp, time_ns)
        _stamp(entity.lifetime, lifetime_ns)
        for key, value in boxes.about(row).items():
            entity.metadata.add(key=key, value=value)
        x, y, heading = boxes.place[row].tolist()
        box = entity.cubes.add()
        _pose(box.pose, x, y, 0.5 * HEIGHT_M, heading)
        length, width = boxes.size_m[row].tolist()
        box.size.x, box.size.y, box.size.z = length, width, HEIGHT_M
        _colour(box.color, boxes.colour[row], boxes.alpha)
        if boxes.label:
            text = entity.texts.add(billboard=True, font_size=TEXT_M, text=boxes.name[row])
            _pose(text.pose, x, y, HEIGHT_M + TEXT_M, 0.0)
            _colour(text.color, boxes.colour[row], 1.0)
    return scene


def _road(run: RecordedRun, time_ns: int) -> SceneUpdate:
    """Return the lanes' lines, which stay."""
    scene, lanes = SceneUpdate(), lanes_of(run)
    entity: SceneEntity = scene.entities.add(frame_id=MAP, id="lanes")
    _stamp(entity.timestamp, time_ns)
    for line in lanes.lines:
        drawn = entity.lines.add(type=LinePrimitive.LINE_STRIP, thickness=LINE_M)
        drawn.pose.orientation.w = 1.0
        _colour(drawn.color, LANE_COLOUR, 1.0)
        for x, y in line.points(lanes.road).tolist():
            drawn.points.add(x=x, y=y, z=0.0)
    return scene


def _stamp(stamp: Any, time_ns: int) -> None:  # noqa: ANN401
    stamp.seconds, stamp.nanos = divmod(time_ns, NANOSECONDS)


def _pose(pose: Any, x: float, y: float, z: float, heading: float) -> None:  # noqa: ANN401
    pose.position.x, pose.position.y, pose.position.z = x, y, z
    pose.orientation.z, pose.orientation.w = np.sin(0.5 * heading), np.cos(0.5 * heading)


def _colour(colour: Any, name: str, alpha: float) -> None:  # noqa: ANN401
    colour.r, colour.g, colour.b = (int(name[k : k + 2], 16) / 255.0 for k in (1, 3, 5))
    colour.a = alpha
