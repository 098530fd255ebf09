"""What the tracker's own tracks hide: the expected visible fraction of each particle's vehicle.

Each particle looks up the rays over its extent in the table of nearest surfaces (``mmpf.visibility.depth``).
"""

import numpy as np

from mmpf.map.sensor_plane import SensorPlane
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.numerics.kernels import kernel, part_of_kernel
from mmpf.numerics.threads import in_shares
from mmpf.scan import FreeSpace
from mmpf.visibility.depth import DepthTable, Occluders, headings_in_plane

LARGEST_RAY_COUNT = 16
# Where the rays over a vehicle's extent lie, as shares of its half-width.
RAY_PLACES = (2.0 * np.arange(LARGEST_RAY_COUNT) + 1.0) / LARGEST_RAY_COUNT - 1.0


def visible_fractions(
    plane: SensorPlane, lon_m: FloatArray, lat_m: FloatArray, component: IntArray, bodies: Occluders, table: DepthTable
) -> FloatArray:
    """Return the share of each particle's angular extent that no other component's shadow covers, shape (n,).

    Args:
        plane: The plane around the sensor.
        lon_m: Particles' longitudinal positions, shape (n,).
        lat_m: Particles' lateral positions, shape (n,).
        component: Each particle's component, whose own shadow does not count, shape (n,).
        bodies: Sizes of the components' vehicles.
        table: The surfaces around, of these components.
    """
    fraction = np.empty(len(lon_m))
    x, y = plane.seen_from_sensor(lon_m, lat_m)
    outlines = *bodies.halves, np.cos(table.heading_rad), np.sin(table.heading_rad)

    def look_up(begin: int, end: int) -> None:
        some = slice(begin, end)
        _look_up_rays(x[some], y[some], component[some], table, outlines, fraction[some])

    in_shares(look_up, len(fraction), cost=2.0)
    return fraction


def shadowed_share(
    plane: SensorPlane, lon_m: FloatArray, lat_m: FloatArray, bodies: Occluders, free_space: FreeSpace
) -> FloatArray:
    """Return the share of each vehicle's angular extent that the sensor itself asserts to lie in shadow, shape (m,).

    Args:
        plane: The plane around the sensor.
        lon_m: Longitudinal positions, shape (m,).
        lat_m: Lateral positions, shape (m,).
        bodies: The vehicles' sizes, shape (m,).
        free_space: The sensor's own free distances, by Cartesian bearing.
    """
    x, y = plane.seen_from_sensor(lon_m, lat_m)
    distance = np.hypot(x, y)
    bearing = np.arctan2(y, x)
    # The rectangle's silhouette across the line of sight.
    slant = bearing - headings_in_plane(plane, lon_m, bodies)
    across = 0.5 * (bodies.length_m * np.abs(np.sin(slant)) + bodies.width_m * np.abs(np.cos(slant)))
    half = np.arctan(across / np.maximum(distance, 1e-6))
    sectors = len(free_space.range_m)
    rays = plane.turn_rad + bearing + half * RAY_PLACES[:, None]
    sector = np.floor((rays + np.pi) * sectors / (2.0 * np.pi)).astype(np.int64) % sectors
    return np.asarray((free_space.range_m[sector] < distance).mean(axis=0))


@kernel()
def _look_up_rays(
    x: FloatArray,
    y: FloatArray,
    component: IntArray,
    table: DepthTable,
    outlines: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    fraction: FloatArray,
) -> None:
    """Write the share of each particle's rays that reach it; positions are from the sensor, sizes by component."""
    half_length, half_width, cosine, sine = outlines
    begin = 0
    while begin < len(x):
        end = begin + 1
        while end < len(x) and component[end] == component[begin]:
            end += 1
        own = component[begin]
        own_x, own_y = x[begin:end], y[begin:end]
        outline = half_length[own], half_width[own], cosine[own], sine[own]
        alike = _fraction_of_all(own_x, own_y, own, table, outline)
        if alike >= 0.0:
            fraction[begin:end] = alike
        else:
            _fraction_of_each(own_x, own_y, own, table, outline, fraction[begin:end])
        begin = end


@part_of_kernel()
def _fraction_of_all(
    x: FloatArray, y: FloatArray, own: int, table: DepthTable, outline: tuple[float, float, float, float]
) -> float:
    """Return 1 if nothing is before the box around a whole component, 0 if all of it is in shadow, else -1.

    Exact: where it says 1 or 0, every ray of every particle would.
    """
    (depth, caster, _), (half_length, half_width, cosine, sine) = table, outline
    low_x, high_x, low_y, high_y = x[0], x[0], y[0], y[0]
    for n in range(len(x)):
        low_x, high_x = min(low_x, x[n]), max(high_x, x[n])
        low_y, high_y = min(low_y, y[n]), max(high_y, y[n])
    if low_x <= 0.0 and low_y <= 0.0 <= high_y:
        # Around the sensor or across the table's ends, where the box's corners are not its outermost bearings.
        return -1.0
    apart_x, apart_y = max(low_x, -high_x, 0.0), max(low_y, -high_y, 0.0)
    far_x, far_y = max(abs(low_x), abs(high_x)), max(abs(low_y), abs(high_y))
    near, far = np.sqrt(apart_x * apart_x + apart_y * apart_y), np.sqrt(far_x * far_x + far_y * far_y)
    corners = (_bearing(low_x, low_y), _bearing(low_x, high_y), _bearing(high_x, low_y), _bearing(high_x, high_y))
    far_along, far_across = far_x * abs(cosine) + far_y * abs(sine), far_y * abs(cosine) + far_x * abs(sine)
    half = _arctangent((half_length * far_across + half_width * far_along) / max(near * near, 1e-12))
    sectors = depth.shape[1]
    per_radian = sectors / (2.0 * np.pi)
    first = int(np.floor((min(corners) - half + np.pi) * per_radian - 1e-6))
    last = int(np.floor((max(corners) + half + np.pi) * per_radian + 1e-6))
    is_clear, is_shadowed = True, True
    for k in range(first, last + 1):
        sector = k % sectors
        surface = depth[1, sector] if caster[0, sector] == own else depth[0, sector]
        is_clear &= surface >= far
        is_shadowed &= surface < near
        if not is_clear and not is_shadowed:
            return -1.0
    return 1.0 if is_clear else 0.0


@part_of_kernel()
def _fraction_of_each(
    x: FloatArray,
    y: FloatArray,
    own: int,
    table: DepthTable,
    outline: tuple[float, float, float, float],
    fraction: FloatArray,
) -> None:
    """Look up the rays of each particle."""
    (depth, caster, _), (half_length, half_width, cosine, sine) = table, outline
    sectors = depth.shape[1]
    per_radian = sectors / (2.0 * np.pi)
    # Two turns, since a vehicle may lie across the table's ends.
    surface = np.empty(2 * sectors)
    for k in range(sectors):
        surface[k] = surface[sectors + k] = depth[1, k] if caster[0, k] == own else depth[0, k]
    distance, halves, places = np.empty(len(x)), np.empty(len(x)), np.empty(len(x))
    # Without branches, so that the compiler turns it into vector instructions.
    for n in range(len(x)):
        distance[n] = np.sqrt(x[n] * x[n] + y[n] * y[n])
        # The rectangle's silhouette: half-width across the line of sight over the distance.
        along_it, across_it = abs(x[n] * cosine + y[n] * sine), abs(y[n] * cosine - x[n] * sine)
        across = (half_length * across_it + half_width * along_it) / max(distance[n], 1e-6)
        halves[n] = _arctangent(across / max(distance[n], 1e-6)) * per_radian
        places[n] = (_bearing(x[n], y[n]) + np.pi) * per_radian
    for n in range(len(x)):
        half = halves[n]
        rays = min(max(int(2.0 * half), 3), LARGEST_RAY_COUNT)
        step = 2.0 * half / rays
        first = places[n] - half + 0.5 * step
        if first < 0.0:
            first += sectors
        clear = 0
        for k in range(rays):
            clear += surface[int(first + k * step)] >= distance[n]
        fraction[n] = clear / rays


@part_of_kernel()
def _bearing(x: float, y: float) -> float:
    """Return the direction of a point seen from the origin, as ``arctan2(y, x)``."""
    largest = max(abs(x), abs(y))
    angle = _arctangent(min(abs(x), abs(y)) / (largest if largest > 0.0 else 1.0))
    angle = 0.5 * np.pi - angle if abs(y) > abs(x) else angle
    angle = np.pi - angle if x < 0.0 else angle
    return -angle if y < 0.0 else angle


@part_of_kernel()
def _arctangent(t: float) -> float:
    """Return the arctangent of a number that is not negative, in half the library's time (Moshier's Cephes)."""
    is_large, is_middle = t > 2.414213562373095, t > 0.66
    offset = 0.5 * np.pi if is_large else (0.25 * np.pi if is_middle else 0.0)
    above, below = (
        (-1.0 if is_large else (t - 1.0 if is_middle else t)),
        (t if is_large else (t + 1.0 if is_middle else 1.0)),
    )
    t = above / below
    z = t * t
    above = -8.750608600031904122785e-1
    above = above * z - 1.615753718733365076637e1
    above = above * z - 7.500855792314704667340e1
    above = above * z - 1.228866684490136173410e2
    above = above * z - 6.485021904942025371773e1
    below = z + 2.485846490142306297962e1
    below = below * z + 1.650270098316988542046e2
    below = below * z + 4.328810604912902668951e2
    below = below * z + 4.853903996359136964868e2
    below = below * z + 1.945506571482613964425e2
    return offset + (t + t * z * above / below)
