"""Trajectories in the plane as recorded traffic, with lanes given by centre lines or without lanes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np

from harness.common.bounds import PLACE_M, TURNED_RAD, Numbers, check_numbers
from harness.common.errors import InputError
from harness.common.untrusted_files import reading, unpacked
from harness.truth.network.polyline import grid_origin, length_of
from harness.truth.recorded.laneletgraph import plane_of_lanelets
from harness.truth.recorded.lanelets import Lanelet
from harness.truth.recorded.order import ROWS
from harness.truth.recorded.rows import ReadTraffic, rows_in
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, turned, wrapped
from mmpf.scan import UNKNOWN_CLASS

USUAL_LANE_M = 3.5
# A lane that begins so near to where another ends, nearly in its direction, follows it.
MEETS_WITHIN_M, MEETS_WITHIN_RAD = 1.0, np.deg2rad(45.0)
BESIDE_WITHIN_RAD = np.deg2rad(20.0)
SHORTEST_LINE_M = 0.5
OF_WAYS = ROWS | {"heading_rad": TURNED_RAD}
OF_LINES = {"a point": PLACE_M, "the length": Numbers(0.0, 1e5), "the width": Numbers(0.1, 100.0)}


@dataclass(frozen=True)
class PlaneTrajectory:
    """One vehicle's way; arrays of shape (n,), of whatever a reader takes for numbers; an unknown speed is nan.

    Attributes:
        vehicle_class: Code of its class, see ``mmpf.scan.VEHICLE_CLASSES``.
    """

    name: str
    time_s: FloatArray
    x_m: FloatArray
    y_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray
    length_m: FloatArray
    width_m: FloatArray
    vehicle_class: int = UNKNOWN_CLASS


@dataclass(frozen=True)
class MiddleLine:
    """A lane by its middle line in driving direction, shape (p, 2), and its width."""

    xy: FloatArray
    width_m: float = USUAL_LANE_M


Scene = tuple[Sequence[PlaneTrajectory], Mapping[str, MiddleLine], int]
"""Vehicles' ways, lanes by name, and how many other things there are."""


def traffic_of_scene(path: Path, load: Callable[[BinaryIO], Scene], what: str) -> ReadTraffic:
    """Read a file of a scene as another program wrote it.

    Raises:
        InputError: It is no such file, or lacks what is needed; see ``traffic_of_ways``.
    """
    with reading(path, what), unpacked(path) as file:
        ways, lines, others = load(file)
    return traffic_of_ways(ways, lines, path, {"no vehicle": others})


def traffic_of_ways(
    ways: Sequence[PlaneTrajectory], lines: Mapping[str, MiddleLine], path: Path, left_out: Mapping[str, int]
) -> ReadTraffic:
    """Return ways as traffic in the plane.

    Raises:
        InputError: There is no vehicle, one has no name of its own, or a value can't be.
    """
    ways = [way for way in ways if len(way.time_s)]
    if not ways:
        raise InputError(f"{path}: there is no vehicle in it; give a recording of traffic")
    names = np.array([way.name for way in ways])
    if len(np.unique(names)) < len(names) or not np.char.str_len(names).all():
        raise InputError(f"{path}: a vehicle has no name, or two have the same; rename one")
    columns = {
        name: np.concatenate([np.asarray(getattr(way, name), dtype=np.float64) for way in ways])
        for name in ("time_s", "x_m", "y_m", "heading_rad", "speed_mps", "length_m", "width_m")
    }
    check_numbers(path, columns, OF_WAYS)
    road, origin = _plane(lines, np.array([columns["x_m"].min(), columns["y_m"].min()]), path)
    rows = rows_in(
        road,
        origin,
        np.repeat(np.arange(len(ways)), [len(way.time_s) for way in ways]),
        columns["time_s"],
        (columns["x_m"], columns["y_m"], columns["heading_rad"]),
        columns["speed_mps"],
        (columns["length_m"], columns["width_m"]),
    )
    classes = np.array([way.vehicle_class for way in ways], dtype=np.int64)
    told = classes if (classes != UNKNOWN_CLASS).any() else None
    return ReadTraffic(road, names, rows, len(ways) + sum(left_out.values()), left_out, told)


def _plane(lines: Mapping[str, MiddleLine], low: FloatArray, path: Path) -> tuple[Road, tuple[float, float]]:
    if not lines:
        x, y = grid_origin(low).tolist()
        return LaneGraphRoad(graph=without_map()), (x, y)
    return plane_of_lanelets(lanelets_of(lines, path), path)


def lanelets_of(lines: Mapping[str, MiddleLine], path: Path) -> list[Lanelet]:
    """Return lanes with what follows each and what lies beside it, as far as places and directions tell.

    Raises:
        InputError: A line or its width can't be, or there are too many lines.
    """
    kept: dict[str, MiddleLine] = {}
    for name, line in lines.items():
        if line.xy.ndim != 2 or line.xy.shape[1] != 2:
            raise InputError(f"{path}: lane {name} is no line of points in the plane; mend it")
        xy = line.xy[np.append(True, np.hypot(*np.diff(line.xy, axis=0).T) > 1e-3)] if len(line.xy) else line.xy
        length_m = length_of(xy) if len(xy) > 1 else 0.0
        told = {"a point": xy, "the length": length_m, "the width": line.width_m}
        check_numbers(path, told, OF_LINES, f"lane {name}")
        if length_m >= SHORTEST_LINE_M:
            kept[name] = MiddleLine(xy, line.width_m)
    if not kept:
        return []
    names = list(kept)
    first, last = (np.array([line.xy[k] for line in kept.values()]) for k in (0, -1))
    begins, ends = (
        np.array([np.arctan2(*(line.xy[k + 1] - line.xy[k])[::-1]) for line in kept.values()]) for k in (0, -2)
    )
    near = np.hypot(*(last[:, None] - first[None, :]).transpose(2, 0, 1)) <= MEETS_WITHIN_M
    follows = near & (np.abs(wrapped(begins[None, :] - ends[:, None])) <= MEETS_WITHIN_RAD)
    np.fill_diagonal(follows, False)
    beside = _beside(list(kept.values()))
    found: list[Lanelet] = []
    for k, (name, line) in enumerate(kept.items()):
        left, right = (names[at] if at >= 0 else None for at in beside[k])
        successors = tuple(names[to] for to in np.flatnonzero(follows[k]))
        found.append(Lanelet(name, _aside(line, 0.5), _aside(line, -0.5), successors, left, right))
    return found


def _beside(lines: Sequence[MiddleLine]) -> list[tuple[int, int]]:
    """Return the lanes to the left and right of each that lead the same way about a width away; -1 for none."""
    half = [len(line.xy) // 2 for line in lines]
    middle = np.array([line.xy[k] for line, k in zip(lines, half, strict=True)])
    along = [np.arctan2(*(line.xy[k] - line.xy[k - 1])[::-1]) for line, k in zip(lines, half, strict=True)]
    points = np.concatenate([line.xy for line in lines])
    owner = np.repeat(np.arange(len(lines)), [len(line.xy) for line in lines])
    directions = np.concatenate([np.arctan2(*np.gradient(line.xy, axis=0).T[::-1]) for line in lines])
    found: list[tuple[int, int]] = []
    for k, line in enumerate(lines):
        offset = points - middle[k]
        ahead_m, left_m = turned(offset[:, 0], offset[:, 1], along[k])
        fits = (owner != k) & (np.abs(wrapped(directions - along[k])) <= BESIDE_WITHIN_RAD) & (np.abs(ahead_m) <= 5.0)
        fits &= (np.abs(left_m) >= 0.6 * line.width_m) & (np.abs(left_m) <= 1.6 * line.width_m)
        sides: list[int] = []
        for side in (1.0, -1.0):
            on_side = np.flatnonzero(fits & (side * left_m > 0.0))
            nearest = on_side[np.argmin(np.hypot(*offset[on_side].T))] if len(on_side) else -1
            sides.append(int(owner[nearest]) if nearest >= 0 else -1)
        found.append((sides[0], sides[1]))
    return found


def _aside(line: MiddleLine, widths: float) -> FloatArray:
    """Return a line so many widths to the left of a middle line, shape (p, 2)."""
    along = np.gradient(line.xy, axis=0)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    return np.asarray(line.xy + widths * line.width_m * normal)
