"""The distance from the sensor to the nearest surface of vehicles and walls, as a table over bearing.

Every component that probably exists is a rectangle of its estimated size, which points along the road at its place or
where it is said to point. The table holds the two nearest surfaces, so that no component lies in its own shadow.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mmpf.map.road import wall_bodies
from mmpf.map.sensor_plane import SensorPlane
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray
from mmpf.numerics.kernels import kernel, part_of_kernel

BEARINGS = 1440
# Walls farther away hide nothing within any sensor's range.
WALLS_WITHIN_M = 250.0


@dataclass(frozen=True)
class Occluders:
    """Sizes of the components' vehicles, struct of arrays of shape (m,).

    Attributes:
        length_m: Lengths.
        width_m: Widths.
        turn_rad: Where they point against the frame's longitudinal axis; None for along it.
    """

    length_m: FloatArray
    width_m: FloatArray
    turn_rad: FloatArray | None = None

    @property
    def halves(self) -> tuple[FloatArray, FloatArray]:
        """Half of each length and width, metres, shape (m,)."""
        return 0.5 * self.length_m, 0.5 * self.width_m


class DepthTable(NamedTuple):
    """The two nearest surfaces in each bearing sector.

    Attributes:
        depth_m: Distance of the surface, infinite where there is none, shape (2, BEARINGS).
        caster: Index of the component that it belongs to, -1 where there is none, shape (2, BEARINGS).
        heading_rad: Direction in which each component's vehicle points against the plane's x axis, shape (m,).
    """

    depth_m: FloatArray
    caster: IntArray
    heading_rad: FloatArray


def depth_table(
    plane: SensorPlane, lon_m: FloatArray, lat_m: FloatArray, casts_shadow: BoolArray, bodies: Occluders
) -> DepthTable:
    """Return the surfaces that the components' rectangles present to the sensor.

    Args:
        plane: The plane around the sensor.
        lon_m: Components' mean longitudinal positions, shape (m,).
        lat_m: Components' mean lateral positions, shape (m,).
        casts_shadow: Which of them count, shape (m,).
        bodies: Their sizes.
    """
    depth = np.full((2, BEARINGS), np.inf)
    caster = np.full((2, BEARINGS), -1, dtype=np.int64)
    x, y = plane.seen_from_sensor(lon_m, lat_m)
    heading = headings_in_plane(plane, lon_m, bodies)
    _cast_shadows(x, y, casts_shadow, *bodies.halves, np.cos(heading), np.sin(heading), depth, caster)
    if plane.road.walls_xy is not None:
        _cast_walls(plane, depth, caster)
    return DepthTable(depth, caster, heading)


def headings_in_plane(plane: SensorPlane, lon_m: FloatArray, bodies: Occluders) -> FloatArray:
    """Return the bodies' headings against the plane's x axis, shape (m,)."""
    along_the_road = plane.heading_rad(lon_m)
    return along_the_road if bodies.turn_rad is None else along_the_road + bodies.turn_rad


def _cast_walls(plane: SensorPlane, depth: FloatArray, caster: IntArray) -> None:
    """Add the surfaces of walls, as thin rectangles; they belong to no component."""
    ego = plane.ego
    x, y, heading, length, width = wall_bodies(plane.road.walls_near(ego.lon_m, ego.lat_m, WALLS_WITHIN_M))
    x, y, casts = x - ego.lon_m, y - ego.lat_m, np.ones(len(x), dtype=np.bool_)
    surfaces, of_wall = np.full_like(depth, np.inf), np.full_like(caster, -1)
    _cast_shadows(x, y, casts, 0.5 * length, 0.5 * width, np.cos(heading), np.sin(heading), surfaces, of_wall)
    _put_before(surfaces[0], depth, caster)


@kernel()
def _put_before(surface: FloatArray, depth: FloatArray, caster: IntArray) -> None:
    """Insert surfaces that belong to no component, one a sector, among the two nearest of each sector."""
    for k in range(len(surface)):
        if surface[k] < depth[0, k]:
            depth[1, k], caster[1, k] = depth[0, k], caster[0, k]
            depth[0, k], caster[0, k] = surface[k], -1
        elif surface[k] < depth[1, k]:
            depth[1, k], caster[1, k] = surface[k], -1


@kernel()
def _cast_shadows(
    x: FloatArray,
    y: FloatArray,
    casts_shadow: BoolArray,
    half_length: FloatArray,
    half_width: FloatArray,
    cosine: FloatArray,
    sine: FloatArray,
    depth: FloatArray,
    caster: IntArray,
) -> None:
    sectors = depth.shape[1]
    width = 2.0 * np.pi / sectors
    for m in range(len(x)):
        if not casts_shadow[m]:
            continue
        # In the rectangle's own frame it lies along the axes.
        turned_x, turned_y = x[m] * cosine[m] + y[m] * sine[m], y[m] * cosine[m] - x[m] * sine[m]
        if abs(turned_x) <= half_length[m] and abs(turned_y) <= half_width[m]:
            continue
        turned_centre, half = _angular_extent(turned_x, turned_y, half_length[m], half_width[m])
        centre = turned_centre + np.arctan2(sine[m], cosine[m])
        first = int(np.floor((centre - half + np.pi) / width))
        last = int(np.floor((centre + half + np.pi) / width))
        for k in range(first, last + 1):
            bearing = -np.pi + (k + 0.5) * width
            ray_x, ray_y = np.cos(bearing), np.sin(bearing)
            turned_ray = ray_x * cosine[m] + ray_y * sine[m], ray_y * cosine[m] - ray_x * sine[m]
            entry = _ray_entry(*turned_ray, turned_x, turned_y, half_length[m], half_width[m])
            if entry < 0.0:
                continue
            sector = k % sectors
            if entry < depth[0, sector]:
                depth[1, sector], caster[1, sector] = depth[0, sector], caster[0, sector]
                depth[0, sector], caster[0, sector] = entry, m
            elif entry < depth[1, sector]:
                depth[1, sector], caster[1, sector] = entry, m


@part_of_kernel()
def _angular_extent(x: float, y: float, half_length: float, half_width: float) -> tuple[float, float]:
    """Return the centre bearing and the half-width of a rectangle's extent, seen from the origin outside of it."""
    centre = np.arctan2(y, x)
    cosine, sine = np.cos(centre), np.sin(centre)
    half = 0.0
    for corner in range(4):
        corner_x = x + (half_length if corner % 2 == 0 else -half_length)
        corner_y = y + (half_width if corner < 2 else -half_width)
        along = corner_x * cosine + corner_y * sine
        across = corner_y * cosine - corner_x * sine
        half = max(half, abs(np.arctan2(across, along)))
    return centre, half


@part_of_kernel()
def _ray_entry(cosine: float, sine: float, x: float, y: float, half_length: float, half_width: float) -> float:
    """Return the distance at which a ray from the origin enters the rectangle (slab test), -1 if it misses."""
    enter, leave = 0.0, np.inf
    for direction, centre, half in ((cosine, x, half_length), (sine, y, half_width)):
        if abs(direction) < 1e-12:
            if abs(centre) > half:
                return -1.0
            continue
        near, far = (centre - half) / direction, (centre + half) / direction
        if near > far:
            near, far = far, near
        enter, leave = max(enter, near), min(leave, far)
    return enter if enter <= leave else -1.0
