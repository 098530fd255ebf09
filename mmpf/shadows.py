"""What the tracker's own tracks hide from the sensor: the expected visible fraction of each particle's vehicle.

Every component that probably exists casts a shadow behind a rectangle of its estimated size. A table over bearing
holds the two nearest surfaces, so that no component lies in its own shadow; each particle looks up the rays over its
extent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from mmpf.ray_lookup import look_up_rays
from mmpf.road import FloatArray, IntArray
from mmpf.scan import EgoPose, FreeSpace
from mmpf.threads import in_shares

BEARINGS = 1440


@dataclass(frozen=True)
class Bodies:
    """Sizes of the components' vehicles, struct of arrays of shape (m,).

    Attributes:
        length_m: Lengths.
        width_m: Widths.
    """

    length_m: FloatArray
    width_m: FloatArray


@dataclass(frozen=True)
class DepthTable:
    """The two nearest surfaces in each bearing sector, shapes (2, BEARINGS).

    Attributes:
        depth_m: Distance of the surface, infinite where there is none.
        caster: Index of the component that it belongs to, -1 where there is none.
    """

    depth_m: FloatArray
    caster: IntArray


def depth_table(
    ego: EgoPose,
    lon_m: FloatArray,
    lat_m: FloatArray,
    casts_shadow: npt.NDArray[np.bool_],
    bodies: Bodies,
) -> DepthTable:
    """Return the surfaces that the components' rectangles present to the sensor.

    Args:
        ego: Pose of the sensor.
        lon_m: Components' mean longitudinal positions, shape (m,).
        lat_m: Components' mean lateral positions, shape (m,).
        casts_shadow: Which of them count, shape (m,).
        bodies: Their sizes; they are taken to point along the road.
    """
    depth = np.full((2, BEARINGS), np.inf)
    caster = np.full((2, BEARINGS), -1, dtype=np.int64)
    _cast_shadows(
        lon_m - ego.lon_m,
        lat_m - ego.lat_m,
        casts_shadow,
        0.5 * bodies.length_m,
        0.5 * bodies.width_m,
        depth,
        caster,
    )
    return DepthTable(depth, caster)


def visible_fractions(
    ego: EgoPose, lon_m: FloatArray, lat_m: FloatArray, component: IntArray, bodies: Bodies, table: DepthTable
) -> FloatArray:
    """Return the share of each particle's angular extent that no other component's shadow covers, shape (n,).

    Args:
        ego: Pose of the sensor.
        lon_m: Particles' longitudinal positions, shape (n,).
        lat_m: Particles' lateral positions, shape (n,).
        component: Each particle's component, whose own shadow does not count, shape (n,).
        bodies: Sizes of the components' vehicles.
        table: The surfaces around.
    """
    fraction = np.empty(len(lon_m))
    x, y = lon_m - ego.lon_m, lat_m - ego.lat_m
    half_length, half_width = 0.5 * bodies.length_m, 0.5 * bodies.width_m

    def look_up(begin: int, end: int) -> None:
        some = slice(begin, end)
        look_up_rays(
            x[some],
            y[some],
            component[some],
            table.depth_m,
            table.caster,
            half_length,
            half_width,
            fraction[some],
        )

    in_shares(look_up, len(fraction), cost=2.0)
    return fraction


def shadowed_share(
    ego: EgoPose, lon_m: FloatArray, lat_m: FloatArray, bodies: Bodies, free_space: FreeSpace
) -> FloatArray:
    """Return the share of each vehicle's angular extent that the sensor itself asserts to lie in shadow, shape (m,).

    Args:
        ego: Pose of the sensor.
        lon_m: Longitudinal positions, shape (m,).
        lat_m: Lateral positions, shape (m,).
        bodies: The vehicles' sizes, shape (m,).
        free_space: The sensor's own free distances.
    """
    depth = np.full((2, len(free_space.range_m)), np.inf)
    depth[0] = free_space.range_m
    caster = np.full(depth.shape, -2, dtype=np.int64)
    fraction = np.empty(len(lon_m))
    half_length, half_width = 0.5 * bodies.length_m, 0.5 * bodies.width_m
    each = np.arange(len(lon_m))
    look_up_rays(lon_m - ego.lon_m, lat_m - ego.lat_m, each, depth, caster, half_length, half_width, fraction)
    return 1.0 - fraction


@numba.njit(cache=True)
def _cast_shadows(
    x: FloatArray,
    y: FloatArray,
    casts_shadow: npt.NDArray[np.bool_],
    half_length: FloatArray,
    half_width: FloatArray,
    depth: FloatArray,
    caster: IntArray,
) -> None:
    sectors = depth.shape[1]
    width = 2.0 * np.pi / sectors
    for m in range(len(x)):
        if not casts_shadow[m]:
            continue
        if abs(x[m]) <= half_length[m] and abs(y[m]) <= half_width[m]:
            continue
        centre, half = _angular_extent(x[m], y[m], half_length[m], half_width[m])
        first = int(np.floor((centre - half + np.pi) / width))
        last = int(np.floor((centre + half + np.pi) / width))
        for k in range(first, last + 1):
            bearing = -np.pi + (k + 0.5) * width
            entry = _ray_entry(np.cos(bearing), np.sin(bearing), x[m], y[m], half_length[m], half_width[m])
            if entry < 0.0:
                continue
            sector = k % sectors
            if entry < depth[0, sector]:
                depth[1, sector], caster[1, sector] = depth[0, sector], caster[0, sector]
                depth[0, sector], caster[0, sector] = entry, m
            elif entry < depth[1, sector]:
                depth[1, sector], caster[1, sector] = entry, m


@numba.njit(cache=True)
def _angular_extent(x: float, y: float, half_length: float, half_width: float) -> tuple[float, float]:
    """Return the centre bearing and the half-width of an axis-aligned rectangle's extent, seen from the origin."""
    centre = np.arctan2(y, x)
    if abs(x) <= half_length and abs(y) <= half_width:
        return centre, np.pi
    cosine, sine = np.cos(centre), np.sin(centre)
    half = 0.0
    for corner in range(4):
        corner_x = x + (half_length if corner % 2 == 0 else -half_length)
        corner_y = y + (half_width if corner < 2 else -half_width)
        along = corner_x * cosine + corner_y * sine
        across = corner_y * cosine - corner_x * sine
        half = max(half, abs(np.arctan2(across, along)))
    return centre, half


@numba.njit(cache=True)
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
