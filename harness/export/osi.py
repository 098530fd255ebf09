"""A run as ASAM OSI traces: ground truth, detections and tracks.

Sensor data is in the frame of the ego, whose origin is declared to be the middle of its box (``bbcenter_to_rear`` is
zero), since nothing is known of its axles. Lanes and the lines between them are in every message of the ground truth,
since each stands for itself. Nothing is known of the paint: a line that bounds two lanes, which vehicles cross, is
declared dashed, one at the road's edge an edge. Detections have their measured sizes, tracks the median of those
measured of them; velocities of tracks are over ground, in the axes of that frame. Numbers of vehicles are those of
``vehicles.csv``.
"""

import struct
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from osi3.osi_detectedobject_pb2 import DetectedItemHeader
from osi3.osi_groundtruth_pb2 import GroundTruth
from osi3.osi_lane_pb2 import Lane as LaneMessage
from osi3.osi_lane_pb2 import LaneBoundary
from osi3.osi_object_pb2 import MovingObject
from osi3.osi_sensordata_pb2 import SensorData

from harness.export.lanes import NO_STRIP, DrivenLanes, LanePolyline, lanes_of
from harness.export.sizes import SIZE, detection_sizes, track_sizes
from harness.running.finished import RecordedRun
from harness.storage.tables import floats, rows_of_steps
from mmpf.numerics.arrays import FloatArray, IntArray, turned

Columns = dict[str, list[Any]]
Describe = Callable[[Any, Columns, int], None]

OSI_VERSION = (3, 8, 0)
HEIGHT_M = 1.5
GROUND_TRUTH, VEHICLES = "ground_truth.osi", "vehicles.csv"
DETECTIONS, TRACKS = "sensor_data_detections.osi", "sensor_data_tracks.osi"


def export(run: RecordedRun, folder: Path) -> list[Path]:
    """Write the three traces and the vehicles' numbers."""
    codes, names = pd.factorize(run.truth["vehicle_id"])
    numbers = {str(name): number for number, name in enumerate(names, start=1)}
    files = [folder / name for name in (GROUND_TRUTH, DETECTIONS, TRACKS, VEHICLES)]
    _write_trace(files[0], _ground_truth(run, codes.astype(np.int64) + 1, first_lane=len(names) + 1))
    found, whose = run.detections, (run.reported[name].to_numpy() for name in ("episode", "track_id"))
    found, tracks = _sized(found, detection_sizes(found)), _sized(run.reported, track_sizes(run, *whose))
    _write_trace(files[1], _sensor_data(run, found, partial(_describe_detection, numbers)))
    _write_trace(files[2], _sensor_data(run, tracks, _describe_track))
    rows = [f"{number},{name}" for name, number in numbers.items()]
    files[3].write_text("\n".join(["number,vehicle_id", *rows]) + "\n", encoding="utf-8")
    return files


def _write_trace(path: Path, messages: Iterable[Any]) -> None:
    """Write messages, each preceded by its length as a 32-bit little-endian number."""
    with path.open("wb") as trace:
        for message in messages:
            content = message.SerializeToString(deterministic=True)
            trace.write(struct.pack("<I", len(content)) + content)


def _ground_truth(run: RecordedRun, number: IntArray, first_lane: int) -> Iterator[GroundTruth]:
    truth, lanes = run.truth, lanes_of(run)
    content = _lane_messages(lanes, first_lane)
    strip = lanes.strip_at(floats(truth, "lon_m"), floats(truth, "lat_m"))
    x, y, heading = run.in_plane(truth)
    names = ("speed_mps", "lat_speed_mps", "accel_mps2", "length_m", "width_m")
    speed, lat_speed, accel, length, width = (floats(truth, name) for name in names)
    along = run.road.heading_at(floats(truth, "lon_m")) + run.road.axis_of(floats(truth, "heading_rad"))
    velocity_x, velocity_y = turned(speed, lat_speed, -along)
    is_ego = truth["is_ego"].to_numpy(dtype=bool)
    for rows in rows_of_steps(truth).values():
        message = GroundTruth()
        _stamp(message, float(floats(truth, "time_s")[rows.start]))
        host = np.flatnonzero(is_ego[rows])
        message.MergeFrom(content)
        if len(host) and strip[rows.start + host[0]] != NO_STRIP:
            message.lane[int(strip[rows.start + host[0]])].classification.is_host_vehicle_lane = True
        for i in range(rows.start, rows.stop):
            vehicle = message.moving_object.add(type=MovingObject.TYPE_VEHICLE)
            vehicle.id.value = int(number[i])
            _place(vehicle.base, x[i], y[i], 0.5 * HEIGHT_M, heading[i], (length[i], width[i]))
            vehicle.base.velocity.x, vehicle.base.velocity.y = velocity_x[i], velocity_y[i]
            vehicle.base.acceleration.x = accel[i] * np.cos(along[i])
            vehicle.base.acceleration.y = accel[i] * np.sin(along[i])
            if strip[i] != NO_STRIP:
                vehicle.moving_object_classification.assigned_lane_id.add(value=first_lane + int(strip[i]))
            if is_ego[i]:
                message.host_vehicle_id.value = int(number[i])
                vehicle.vehicle_attributes.bbcenter_to_rear.x = 0.0
        yield message


def _sensor_data(run: RecordedRun, table: pd.DataFrame, describe: Describe) -> Iterator[SensorData]:
    egos = run.truth[run.truth["is_ego"].to_numpy(dtype=bool)]
    ego_x, ego_y, ego_heading = run.in_plane(egos)
    x, y, heading = run.in_plane(table)
    along = run.road.heading_at(floats(table, "lon_m"))
    rows_of = rows_of_steps(table)
    columns = {str(name): table[name].tolist() for name in table}
    for k, (step, time_s) in enumerate(zip(egos["step"].tolist(), egos["time_s"].tolist(), strict=True)):
        message = SensorData()
        _stamp(message, time_s)
        message.last_measurement_time.CopyFrom(message.timestamp)
        host = message.host_vehicle_location
        host.position.x, host.position.y, host.orientation.yaw = ego_x[k], ego_y[k], ego_heading[k]
        cosine, sine = np.cos(ego_heading[k]), np.sin(ego_heading[k])
        rows = rows_of.get(step, slice(0, 0))
        for i in range(rows.start, rows.stop):
            dx, dy = x[i] - ego_x[k], y[i] - ego_y[k]
            found = message.moving_object.add()
            yaw = heading[i] - ego_heading[k]
            size = columns["length_m"][i], columns["width_m"][i]
            _place(found.base, dx * cosine + dy * sine, dy * cosine - dx * sine, 0.0, yaw, size)
            if "lat_speed_mps" in columns and not run.road.has_headings:  # in the plane tracks have no headings
                velocity = turned(columns["speed_mps"][i], columns["lat_speed_mps"][i], ego_heading[k] - along[i])
                found.base.velocity.x, found.base.velocity.y = velocity
            stds = columns["std_lon_m"][i], columns["std_lat_m"][i]
            turn = ego_heading[k] - along[i]  # deviations are along the road's axes, the message is in the ego's
            found.base_rmse.position.x = float(np.hypot(stds[0] * np.cos(turn), stds[1] * np.sin(turn)))
            found.base_rmse.position.y = float(np.hypot(stds[0] * np.sin(turn), stds[1] * np.cos(turn)))
            describe(found, columns, i)
        yield message


def _sized(table: pd.DataFrame, size_m: FloatArray) -> pd.DataFrame:
    return table.assign(**dict(zip(SIZE, size_m.T, strict=True)))


def _describe_detection(numbers: Mapping[str, int], found: Any, columns: Columns, row: int) -> None:  # noqa: ANN401
    found.header.measurement_state = DetectedItemHeader.MEASUREMENT_STATE_MEASURED
    if (origin := numbers.get(columns["truth_id"][row])) is not None:
        found.header.ground_truth_id.add(value=origin)


def _describe_track(found: Any, columns: Columns, row: int) -> None:  # noqa: ANN401
    seen = columns["state"][row] != "hidden"
    state = "MEASUREMENT_STATE_MEASURED" if seen else "MEASUREMENT_STATE_PREDICTED"
    found.header.measurement_state = getattr(DetectedItemHeader, state)
    found.header.tracking_id.value = int(columns["track_id"][row])
    found.header.existence_probability = float(columns["existence"][row])


def _stamp(message: Any, time_s: float) -> None:  # noqa: ANN401
    version = message.version
    version.version_major, version.version_minor, version.version_patch = OSI_VERSION
    message.timestamp.seconds, message.timestamp.nanos = divmod(round(time_s * 1e9), 1_000_000_000)


def _place(base: Any, x: float, y: float, z: float, yaw: float, size: tuple[float, float]) -> None:  # noqa: ANN401
    base.position.x, base.position.y, base.position.z = x, y, z
    base.orientation.yaw = (yaw + np.pi) % (2.0 * np.pi) - np.pi
    base.dimension.length, base.dimension.width, base.dimension.height = *size, HEIGHT_M


LINE_WIDTH_M = 0.15


def _lane_messages(lanes: DrivenLanes, first_id: int) -> GroundTruth:
    """Return lanes, whose identifiers begin with a number, and their boundaries, whose follow."""
    content = GroundTruth()
    first_line = first_id + len(lanes.strips)
    for number, strip in enumerate(lanes.strips):
        message = content.lane.add()
        message.id.value = first_id + number
        about = message.classification
        about.type, about.subtype = LaneMessage.Classification.TYPE_DRIVING, LaneMessage.Classification.SUBTYPE_NORMAL
        about.centerline_is_driving_direction = True
        middle = LanePolyline(strip.lane.centre_m, strip.lane.start_m, strip.lane.end_m)
        for x, y in middle.points(lanes.road).tolist():
            about.centerline.add(x=x, y=y, z=0.0)
        about.left_lane_boundary_id.add(value=first_line + strip.left)
        about.right_lane_boundary_id.add(value=first_line + strip.right)
        for other in strip.left_neighbours:
            about.left_adjacent_lane_id.add(value=first_id + other)
        for other in strip.right_neighbours:
            about.right_adjacent_lane_id.add(value=first_id + other)
    between = {strip.left for strip in lanes.strips if strip.left_neighbours}
    between |= {strip.right for strip in lanes.strips if strip.right_neighbours}
    for number, line in enumerate(lanes.lines):
        boundary = content.lane_boundary.add()
        boundary.id.value = first_line + number
        kind = "TYPE_DASHED_LINE" if number in between else "TYPE_ROAD_EDGE"
        boundary.classification.type = getattr(LaneBoundary.Classification, kind)
        for x, y in line.points(lanes.road).tolist():
            point = boundary.boundary_line.add(width=LINE_WIDTH_M)
            point.position.x, point.position.y, point.position.z = x, y, 0.0
    return content
