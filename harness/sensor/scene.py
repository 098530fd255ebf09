"""The geometry between sensor and vehicles in a frame: lines of sight and visible parts."""

from dataclasses import dataclass

import numpy as np

from harness.config.sensor import SensorSettings
from harness.sensor.shadows import sensor_position
from harness.truth.frame import Frame
from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, wrapped
from mmpf.scan import EgoPose


@dataclass(frozen=True)
class Sight:
    """Lines of sight: distance, direction, the same against the axis at the far end, and off the ego's heading."""

    distance: FloatArray
    bearing: FloatArray
    against_axis: FloatArray
    off_axis: FloatArray


@dataclass(frozen=True)
class Scene:
    """A frame and the geometry between the sensor and each of its vehicles: arrays of shape (n,)."""

    settings: SensorSettings
    frame: Frame
    road: Road
    sight: Sight
    fraction: FloatArray
    occluder: IntArray
    in_range: BoolArray

    @property
    def ego(self) -> EgoPose:
        """Pose of the sensor's vehicle."""
        return self.frame.ego_pose

    @property
    def axis_rad(self) -> FloatArray:
        """Direction of each vehicle's box against the frame's longitudinal axis, shape (n,)."""
        return self.road.axis_of(self.frame.heading_rad)


def sight_to(lon_m: FloatArray, lat_m: FloatArray, road: Road, ego: EgoPose, axis_rad: FloatArray | float) -> Sight:
    """Return the lines of sight from the ego's sensor to positions, each of shape (n,).

    Args:
        lon_m: Longitudinal positions, shape (n,).
        lat_m: Lateral positions, shape (n,).
        road: The road.
        ego: Pose of the sensor's vehicle.
        axis_rad: Direction of the box at each position against the road, shape (n,).
    """
    sensor_x, sensor_y = sensor_position(ego, road)
    x, y = road.to_cartesian(lon_m, lat_m)
    bearing = np.arctan2(y - sensor_y, x - sensor_x)
    ego_road = float(road.heading_at(np.array(ego.lon_m)))
    return Sight(
        distance=np.hypot(x - sensor_x, y - sensor_y),
        bearing=bearing,
        against_axis=bearing - road.heading_at(lon_m) - axis_rad,
        off_axis=np.abs(wrapped(bearing - ego_road - ego.heading_rad)),
    )


def in_reach(settings: SensorSettings, distance: FloatArray, off_axis: FloatArray) -> BoolArray:
    """Return what lies within range and field of view, shape (n,)."""
    half_view = np.deg2rad(0.5 * settings.field_of_view_deg)
    return np.asarray(
        (distance <= settings.range_m) & ((off_axis <= half_view) | (settings.field_of_view_deg >= 360.0))
    )
