"""Exact visibility of oriented rectangles from one point in the Cartesian plane.

A ray from the sensor belongs to the rectangle that it meets first. The angles at which that owner can change are the
ends of the rectangles' angular extents and, where rectangles overlap, the corners and edge crossings of the overlap.
Between two neighbouring such angles the order of the rectangles along a ray is constant, so that one ray through the
middle of each interval decides it exactly; nothing is sampled.
"""

import numpy as np
import numpy.typing as npt

from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.numerics.kernels import kernel, part_of_kernel

TWO_PI = 2.0 * np.pi
NO_OCCLUDER = -1
# Surfaces closer together than this, in metres and in proportion to their distance, are one surface.
SAME_SURFACE = 1e-9
# Angles closer together than this, in radians, are one angle.
SAME_ANGLE = 1e-13


def visible_fractions(
    sensor_xy: tuple[float, float] | FloatArray, bodies: FloatArray, walls: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return how much of each body the sensor sees, what covers most of the rest, and how much of it walls cover.

    A rectangle is covered in a direction where another one is met strictly earlier: rectangles that share the surface
    in front are both seen. A rectangle that contains the sensor, or has it on its edge, is met at distance zero in
    every direction: it is wholly visible and everything else is hidden behind it.

    Args:
        bodies: Rows of the rectangles' centres (x and y), headings, lengths and widths, shape (5, n).
        walls: The same of walls, shape (5, w).

    Returns:
        The visible fraction of each body's angular extent, in [0, 1]; the index of the rectangle that comes first over
        most of the covered part, -1 where nothing is covered, from n on that of a wall; and the share of the extent
        over which a wall comes first, in [0, 1]; each of shape (n,).
    """
    boxes, count = pack_boxes(sensor_xy, *np.concatenate([bodies, walls], axis=1)), bodies.shape[1]
    if len(boxes) == 0:
        return np.zeros(0), np.zeros(0, dtype=np.int64), np.zeros(0)
    seen, occluder, behind = _sweep(boxes, count)
    return seen[:count], occluder[:count], behind[:count]


@kernel()
def first_hits(boxes: FloatArray, bearings: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the rectangle that each ray from the sensor meets first.

    Args:
        boxes: Rectangles as ``pack_boxes`` gives them, shape (n, 6).

    Returns:
        Index of the rectangle, -1 where the ray meets none; the distance at which the ray enters it and the distance at
        which it leaves it, both infinite where there is none; each of shape (r,).
    """
    extents = _angular_extents(boxes)
    index = np.empty(len(bearings), dtype=np.int64)
    entry, leave = np.empty(len(bearings)), np.empty(len(bearings))
    for r in range(len(bearings)):
        index[r], entry[r], leave[r] = NO_OCCLUDER, np.inf, np.inf
        cosine, sine = np.cos(bearings[r]), np.sin(bearings[r])
        for i in range(len(boxes)):
            if (bearings[r] - extents[i, 0]) % TWO_PI < extents[i, 1]:
                near, far = _entry_and_exit(boxes[i], cosine, sine)
                if near < entry[r]:
                    index[r], entry[r], leave[r] = i, near, far
    return index, entry, leave


def pack_boxes(
    sensor_xy: tuple[float, float] | FloatArray,
    centre_x: FloatArray,
    centre_y: FloatArray,
    heading: FloatArray,
    length: FloatArray,
    width: FloatArray,
) -> FloatArray:
    """Return rectangles relative to the sensor: x, y, cosine, sine, half length, half width, shape (n, 6)."""
    columns = (
        np.asarray(centre_x) - sensor_xy[0],
        np.asarray(centre_y) - sensor_xy[1],
        np.cos(heading),
        np.sin(heading),
        0.5 * np.asarray(length),
        0.5 * np.asarray(width),
    )
    return np.ascontiguousarray(np.stack(columns, axis=-1), dtype=np.float64)


def contains_sensor(boxes: FloatArray) -> npt.NDArray[np.bool_]:
    """Return whether the sensor is in each rectangle or on its edge, shape (n,); boxes as ``pack_boxes`` gives them."""
    x, y, cosine, sine, half_length, half_width = boxes.T
    along, across = x * cosine + y * sine, y * cosine - x * sine
    return np.asarray((np.abs(along) <= half_length + SAME_SURFACE) & (np.abs(across) <= half_width + SAME_SURFACE))


def compile_kernels() -> None:
    """Compile what has not been compiled on this machine yet, so that no scan pays for it."""
    bodies = np.array([[9.0], [1.0], [1.0], [1.0], [1.0]])
    visible_fractions((0.0, 0.0), bodies, bodies[:, :0])
    first_hits(pack_boxes((0.0, 0.0), *bodies), np.ones(1))


@kernel()
def _sweep(boxes: FloatArray, first_wall: int) -> tuple[FloatArray, IntArray, FloatArray]:
    """Go round the circle from one order-change angle to the next and share out each interval."""
    extents = _angular_extents(boxes)
    angles, count = _order_change_angles(boxes, extents), len(boxes)
    seen = np.zeros(count)
    total = np.zeros(count)
    covered_by = np.zeros((count, count))
    active = np.empty(count, dtype=np.int64)
    depth = np.empty(count)
    for k in range(len(angles)):
        begin = angles[k]
        end = angles[k + 1] if k + 1 < len(angles) else angles[0] + TWO_PI
        span = end - begin
        if span <= SAME_ANGLE:
            continue
        middle = 0.5 * (begin + end)
        cosine, sine = np.cos(middle), np.sin(middle)
        hits = 0
        nearest = np.inf
        first = NO_OCCLUDER
        for i in range(count):
            if (middle - extents[i, 0]) % TWO_PI < extents[i, 1]:
                depth[hits] = _entry_and_exit(boxes[i], cosine, sine)[0]
                active[hits] = i
                if depth[hits] < nearest:
                    nearest = depth[hits]
                    first = i
                hits += 1
        limit = nearest + SAME_SURFACE * (1.0 + nearest)
        for h in range(hits):
            i = active[h]
            total[i] += span
            if depth[h] <= limit:
                seen[i] += span
            else:
                covered_by[i, first] += span
    fraction, behind = np.empty(count), np.empty(count)
    occluder = np.empty(count, dtype=np.int64)
    for i in range(count):
        fraction[i], behind[i], occluder[i] = 1.0, 0.0, NO_OCCLUDER
        most = covered_by[i].argmax()
        if covered_by[i, most] > 0.0:
            occluder[i] = most
        by_walls = 0.0
        for wall in range(first_wall, count):
            by_walls += covered_by[i, wall]
        if total[i] > 0.0:
            fraction[i] = min(1.0, max(0.0, seen[i] / total[i]))
            behind[i] = min(1.0, by_walls / total[i])
    return fraction, occluder, behind


@part_of_kernel()
def _angular_extents(boxes: FloatArray) -> FloatArray:
    """Return where each rectangle's extent begins, in [0, 2 pi), and how wide it is, shape (n, 2)."""
    extents = np.empty((len(boxes), 2))
    for i in range(len(boxes)):
        if _contains(boxes[i], 0.0, 0.0):
            extents[i, 0], extents[i, 1] = 0.0, TWO_PI
            continue
        towards = np.arctan2(boxes[i, 1], boxes[i, 0])
        low, high = np.inf, -np.inf
        for c in range(4):
            x, y = _corner(boxes[i], c)
            # Seen from outside, no corner of a convex body is half a turn or more away from its centre.
            offset = (np.arctan2(y, x) - towards + np.pi) % TWO_PI - np.pi
            low, high = min(low, offset), max(high, offset)
        extents[i, 0] = (towards + low) % TWO_PI
        extents[i, 1] = high - low
    return extents


@part_of_kernel()
def _order_change_angles(boxes: FloatArray, extents: FloatArray) -> FloatArray:
    """Return ascending angles in [0, 2 pi) between which the order along a ray is constant."""
    angles = [0.0]
    for i in range(len(boxes)):
        angles.append(extents[i, 0])
        angles.append((extents[i, 0] + extents[i, 1]) % TWO_PI)
    for i in range(len(boxes)):
        for j in range(i):
            reach = np.hypot(boxes[i, 4], boxes[i, 5]) + np.hypot(boxes[j, 4], boxes[j, 5])
            if np.hypot(boxes[i, 0] - boxes[j, 0], boxes[i, 1] - boxes[j, 1]) <= reach:
                for c in range(4):
                    for inner, outer in ((i, j), (j, i)):
                        x, y = _corner(boxes[inner], c)
                        if _contains(boxes[outer], x, y):
                            angles.append(np.arctan2(y, x) % TWO_PI)
                    for d in range(4):
                        crosses, x, y = _edge_crossing(boxes[i], c, boxes[j], d)
                        if crosses:
                            angles.append(np.arctan2(y, x) % TWO_PI)
    return _ascending(np.array(angles))


@part_of_kernel()
def _ascending(values: FloatArray) -> FloatArray:
    """Return the values in order, by insertion in place: NumPy's own methods take seconds to compile."""
    for k in range(1, len(values)):
        value, at = values[k], k
        while at > 0 and values[at - 1] > value:
            values[at] = values[at - 1]
            at -= 1
        values[at] = value
    return values


@part_of_kernel()
def _entry_and_exit(box: FloatArray, cosine: float, sine: float) -> tuple[float, float]:
    """Return where a ray that meets the rectangle enters and leaves it (slab method)."""
    origin_x = -box[0] * box[2] - box[1] * box[3]
    origin_y = box[0] * box[3] - box[1] * box[2]
    step_x = cosine * box[2] + sine * box[3]
    step_y = sine * box[2] - cosine * box[3]
    near, far = 0.0, np.inf
    if step_x != 0.0:
        middle, half = -origin_x / step_x, box[4] / abs(step_x)
        near, far = max(near, middle - half), min(far, middle + half)
    if step_y != 0.0:
        middle, half = -origin_y / step_y, box[5] / abs(step_y)
        near, far = max(near, middle - half), min(far, middle + half)
    return near, max(near, far)


@part_of_kernel()
def _corner(box: FloatArray, number: int) -> tuple[float, float]:
    along = box[4] if number in (0, 3) else -box[4]
    across = box[5] if number < 2 else -box[5]
    return box[0] + along * box[2] - across * box[3], box[1] + along * box[3] + across * box[2]


@part_of_kernel()
def _contains(box: FloatArray, x: float, y: float) -> bool:
    """Whether the point lies in the rectangle or on its edge."""
    along = (x - box[0]) * box[2] + (y - box[1]) * box[3]
    across = (y - box[1]) * box[2] - (x - box[0]) * box[3]
    return bool(abs(along) <= box[4] + SAME_SURFACE and abs(across) <= box[5] + SAME_SURFACE)


@part_of_kernel()
def _edge_crossing(box: FloatArray, edge: int, other: FloatArray, other_edge: int) -> tuple[bool, float, float]:
    """Return whether two edges cross, and where; parallel edges do not."""
    ax, ay = _corner(box, edge)
    bx, by = _corner(box, (edge + 1) % 4)
    cx, cy = _corner(other, other_edge)
    dx, dy = _corner(other, (other_edge + 1) % 4)
    ux, uy, vx, vy = bx - ax, by - ay, dx - cx, dy - cy
    cross = ux * vy - uy * vx
    if cross == 0.0:
        return False, 0.0, 0.0
    s = ((cx - ax) * vy - (cy - ay) * vx) / cross
    t = ((cx - ax) * uy - (cy - ay) * ux) / cross
    return (0.0 <= s <= 1.0) and (0.0 <= t <= 1.0), ax + s * ux, ay + s * uy
