"""The plane around the sensor, in which light travels straight even where the road frame bends."""

from dataclasses import dataclass

import numpy as np

from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, turned
from mmpf.scan import EgoPose


@dataclass(frozen=True)
class SensorPlane:
    """Takes road-frame places to the plane whose origin is the sensor and whose x axis is the road's direction there.

    On a straight road that is the road frame itself, shifted.

    Attributes:
        ego: Pose of the sensor.
        road: Where the road leads.
    """

    ego: EgoPose
    road: Road

    def seen_from_sensor(self, lon_m: FloatArray, lat_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return road-frame positions, metres, as x and y from the sensor, metres, each of the arguments' shape."""
        if self.road.is_straight:
            return lon_m - self.ego.lon_m, lat_m - self.ego.lat_m
        ego_lon = np.array(self.ego.lon_m)
        here_x, here_y = self.road.to_cartesian(ego_lon, np.array(self.ego.lat_m))
        x, y = self.road.to_cartesian(lon_m, lat_m)
        return turned(x - here_x, y - here_y, self.turn_rad)

    @property
    def turn_rad(self) -> float:
        """The road's Cartesian direction at the sensor, radians counter-clockwise: that of the plane's x axis."""
        return float(self.road.heading_at(np.array(self.ego.lon_m)))

    def heading_rad(self, lon_m: FloatArray) -> FloatArray:
        """Return the road's direction at longitudinal positions against that at the sensor, the shape of ``lon_m``."""
        if self.road.is_straight:
            return np.zeros_like(lon_m)
        return self.road.heading_at(lon_m) - self.turn_rad

    @property
    def ego_turn_rad(self) -> float:
        """Where the ego's body points against the frame's longitudinal axis; its drift within the road is left out."""
        return float(self.road.axis_of(np.array([self.ego.heading_rad]))[0])

    def distance_m(self, lon_m: FloatArray, lat_m: FloatArray) -> FloatArray:
        """Return how far from the sensor road-frame positions lie, metres, the arguments' shape."""
        x, y = self.seen_from_sensor(lon_m, lat_m)
        # In place: these are all particles' places.
        x *= x
        y *= y
        x += y
        return np.sqrt(x)
