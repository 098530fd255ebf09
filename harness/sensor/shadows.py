"""The sensor's blind areas, computed from its detections alone.

Each detection stands for a vehicle of its measured size, or else a mean car, that points as it was measured, or else
along the road, in the plane along the nearest lane, and off all lanes along the line of sight. The space
behind it, seen from the sensor, is its shadow. The body itself is not: a detected vehicle does not lie in its own
shadow, so that the free distance of a sector ends at the far side of the first body in it.
"""

import numpy as np

from harness.sensor.visibility import contains_sensor, first_hits, pack_boxes
from harness.storage.schema import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, wrapped
from mmpf.scan import Detections, EgoPose, FreeSpace

SECTORS = 720


def free_space(
    detections: Detections, ego: EgoPose, road: Road, range_m: float, field_of_view_rad: float = 2.0 * np.pi
) -> FreeSpace:
    """Return how far the sensor can see in each of 720 sectors.

    The ray through the middle of a sector speaks for the whole of it (half a degree, 0.9 m wide at 100 m).

    Args:
        range_m: Free distance of a sector without a detection.
        field_of_view_rad: Angle of view, centred on the ego's heading; sectors outside it have free distance zero.
    """
    width = 2.0 * np.pi / SECTORS
    bearings = np.asarray(-np.pi + width * (np.arange(SECTORS) + 0.5), dtype=np.float64)
    _, _, leave = first_hits(_shadowing_boxes(detections, ego, road), bearings)
    forward = ego.heading_rad + float(road.heading_at(np.array(ego.lon_m)))
    off_axis = np.abs(wrapped(bearings - forward))
    return FreeSpace(range_m=np.where(off_axis <= 0.5 * field_of_view_rad, np.minimum(leave, range_m), 0.0))


def shadow_polygons(detections: Detections, ego: EgoPose, road: Road, range_m: float) -> list[FloatArray]:
    """Return the outline of each detection's shadow, for drawing.

    A shadow is bounded by the far side of the body, the two rays past its edges, and the arc of the sensor's
    range. Shadows of different detections may overlap.

    Returns:
        One Cartesian polygon per detection whose body lies wholly within range and does not hold the sensor, each of
        shape (k, 2), metres.
    """
    sensor = np.array(sensor_position(ego, road))
    polygons = []
    for box in _shadowing_boxes(detections, ego, road):
        corners = _corners(box)
        if np.hypot(corners[:, 0], corners[:, 1]).max() < range_m:
            polygons.append(sensor + _shadow_outline(corners, range_m))
    return polygons


def sensor_position(ego: EgoPose, road: Road) -> tuple[float, float]:
    """Return where the sensor is in the Cartesian plane, metres."""
    x, y = road.to_cartesian(np.array([ego.lon_m]), np.array([ego.lat_m]))
    return float(x[0]), float(y[0])


def _shadowing_boxes(detections: Detections, ego: EgoPose, road: Road) -> FloatArray:
    """Return the bodies relative to the sensor, shape (n, 6), less those that would stand on it."""
    x, y = road.to_cartesian(detections.lon_m, detections.lat_m)
    if detections.sizes is None:
        length, width = np.full(len(detections), NOMINAL_LENGTH_M), np.full(len(detections), NOMINAL_WIDTH_M)
    else:
        length, width = detections.sizes.length_m, detections.sizes.width_m
    sensor = sensor_position(ego, road)
    if detections.headings is not None:
        heading = detections.headings.heading_rad
    else:
        along_lane = road.lane_heading_at(detections.lon_m, detections.lat_m)
        bearing = np.arctan2(y - sensor[1], x - sensor[0])
        heading = np.where(np.isnan(along_lane), bearing, along_lane)
    boxes = pack_boxes(sensor, x, y, heading, length, width)
    return boxes[~contains_sensor(boxes)]


def _corners(box: FloatArray) -> FloatArray:
    """Return the corners relative to the sensor, counter-clockwise, shape (4, 2)."""
    x, y, cosine, sine, along, across = box
    signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    offsets = signs * (along, across)
    return np.asarray(np.array([x, y]) + offsets @ np.array([[cosine, sine], [-sine, cosine]]))


def _shadow_outline(corners: FloatArray, range_m: float) -> FloatArray:
    """Return the shadow of a convex counter-clockwise body round the far side and back along the arc."""
    centre = corners.mean(axis=0)
    towards = np.arctan2(centre[1], centre[0])
    offset = wrapped(np.arctan2(corners[:, 1], corners[:, 0]) - towards)
    right, left = int(offset.argmin()), int(offset.argmax())
    far_side = corners[[(right + k) % 4 for k in range((left - right) % 4 + 1)]]
    steps = max(2, int(np.ceil((offset[left] - offset[right]) / np.deg2rad(1.0))) + 1)
    bearings = towards + np.linspace(offset[left], offset[right], steps)
    arc = range_m * np.stack([np.cos(bearings), np.sin(bearings)], axis=-1)
    return np.concatenate([far_side, arc])
