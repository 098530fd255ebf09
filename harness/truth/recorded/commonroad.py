"""CommonRoad scenarios, versions 2018b and 2020a: obstacles' trajectories on their lanelets.

Lanelets that all lead one way are a road with a frame of its own; others, as at crossings, are lanes in the plane.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, parse

import numpy as np

from harness.common.bounds import Numbers, check_numbers
from harness.common.errors import InputError
from harness.common.untrusted_files import number, reading, unpacked
from harness.truth.network.polyline import checked_line
from harness.truth.recorded.laneletgraph import road_of_lanelets
from harness.truth.recorded.lanelets import Lanelet
from harness.truth.recorded.rows import ReadTraffic, rows_in
from mmpf.numerics.arrays import FloatArray

ON_FOOT_OR_CYCLE = ("pedestrian", "bicycle")
VERSIONS = ("2018b", "2020a")
OBSTACLES = ("obstacle", "dynamicObstacle", "staticObstacle")
STEP = {"timeStepSize": Numbers(1e-3, 10.0)}
TIMES = {"the time": Numbers(0, 10_000_000, whole=True, rising=True)}
# Traffic signs, as countries number them: speed limits, and to give way or stop.
LIMIT_SIGNS = frozenset({"274", "R2-1"})
GIVE_WAY_SIGNS = frozenset({"205", "206", "R1-1", "R1-2"})


@dataclass(frozen=True)
class _Obstacle:
    """One obstacle: rows of (time step, x, y, orientation, speed), and its size."""

    name: str
    states: FloatArray
    length_m: float
    width_m: float


def read_commonroad(path: Path) -> ReadTraffic:
    """Read a scenario.

    Positions are those of the obstacles' centres. A static obstacle stands there for the whole time. Pedestrians and
    bicycles are left out, and so are obstacles whose future is a set or a probability instead of a trajectory.

    Raises:
        InputError: The file is broken or has no lanelets or no vehicles.
    """
    with reading(path, f"CommonRoad scenario of version {' or '.join(VERSIONS)}"), unpacked(path) as file:
        root = parse(file).getroot()
        version = root.attrib.get("commonRoadVersion")
        if root.tag != "commonRoad" or version not in VERSIONS:
            raise InputError(f"{path}: CommonRoad version {version}; known are {' and '.join(VERSIONS)}")
        step_s = number(root.attrib["timeStepSize"])
        check_numbers(path, {"timeStepSize": step_s}, STEP, "")
        posts = {post.attrib["id"]: _signs(post) for post in root.findall("trafficSign")}
        lanelets = [_lanelet(each, posts) for each in root.findall("lanelet") if each.find("leftBound") is not None]
        reasons = [(each, _reason_to_leave_out(each)) for each in root if each.tag in OBSTACLES]
        kept = [
            (each.tag == "staticObstacle" or each.findtext("role") == "static", _obstacle(each))
            for each, reason in reasons
            if reason is None
        ]
    obstacles, standing = ([each for stands, each in kept if stands == which] for which in (False, True))
    if not lanelets:
        raise InputError(f"{path}: the scenario has no lanelets to take the road from")
    if not obstacles:
        raise InputError(f"{path}: the scenario has no vehicle with a trajectory")
    for what, ids in (
        ("lanelet", [each.name for each in lanelets]),
        ("obstacle", [each.name for each in (*obstacles, *standing)]),
    ):
        if len(set(ids)) < len(ids):
            raise InputError(f"{path}: {what} {max(ids, key=ids.count)} is there twice; remove one")
    for obstacle in (*obstacles, *standing):
        check_numbers(path, {"the time": obstacle.states[:, 0]}, TIMES, f"obstacle {obstacle.name}")
    last = max(obstacle.states[-1, 0] for obstacle in obstacles)
    obstacles += [_lasting(obstacle, last) for obstacle in standing]
    left_out = Counter(reason for _, reason in reasons if reason is not None)
    return _traffic(lanelets, obstacles, step_s, left_out, path)


def _traffic(
    lanelets: Sequence[Lanelet], obstacles: Sequence[_Obstacle], step_s: float, left_out: Counter[str], path: Path
) -> ReadTraffic:
    vehicle = np.repeat(np.arange(len(obstacles)), [len(obstacle.states) for obstacle in obstacles])
    step, x, y, orientation, speed = np.concatenate([obstacle.states for obstacle in obstacles]).T
    road, origin = road_of_lanelets(lanelets, x, y, path)
    sizes = np.array([(obstacle.length_m, obstacle.width_m) for obstacle in obstacles])[vehicle]
    size_m = sizes[:, 0], sizes[:, 1]
    rows = rows_in(road, origin, vehicle, step * step_s, (x, y, orientation), speed, size_m)
    names = np.array([obstacle.name for obstacle in obstacles])
    return ReadTraffic(road, names, rows, len(obstacles) + left_out.total(), left_out)


def _reason_to_leave_out(element: Element) -> str | None:
    if (element.findtext("type") or "").strip() in ON_FOOT_OR_CYCLE:
        return "on foot or bicycle"
    if element.find("occupancySet") is not None or element.find("probabilityDistribution") is not None:
        return "without a trajectory"
    return None


def _lanelet(element: Element, posts: Mapping[str, Mapping[str, float | None]]) -> Lanelet:
    """Return a lanelet with what the signs at it say."""
    signs = [sign for ref in _references(element, "trafficSignRef") for sign in posts.get(ref, {}).items()]
    limits = [limit for kind, limit in signs if kind in LIMIT_SIGNS and limit is not None]
    return Lanelet(
        name=element.attrib["id"],
        left_xy=_points(element.find("leftBound")),
        right_xy=_points(element.find("rightBound")),
        successors=_references(element, "successor"),
        left=_neighbour(element.find("adjacentLeft")),
        right=_neighbour(element.find("adjacentRight")),
        speed_limit_mps=min(limits) if limits else _positive(element.findtext("speedLimit")),
        kinds=tuple((kind.text or "").strip() for kind in element.findall("laneletType")),
        gives_way=any(kind in GIVE_WAY_SIGNS for kind, _ in signs),
        signals=_references(element, "trafficLightRef"),
    )


def _references(element: Element, tag: str) -> tuple[str, ...]:
    return tuple(other.attrib["ref"] for other in element.findall(tag))


def _neighbour(element: Element | None) -> str | None:
    return element.attrib["ref"] if element is not None and element.attrib.get("drivingDir") == "same" else None


def _positive(text: str | None) -> float | None:
    value = np.nan if text is None else number(text)
    return value if 0.0 < value < np.inf else None


def _signs(element: Element) -> dict[str, float | None]:
    """Return the kinds of signs on a post, each with its number, if it has one."""
    found: dict[str, float | None] = {}
    for sign in element.findall("trafficSignElement"):
        kind = (sign.findtext("trafficSignID") or "").strip()
        found[kind] = _positive(sign.findtext("additionalValue")) if kind in LIMIT_SIGNS else None
    return found


def _points(bound: Element | None) -> FloatArray:
    assert bound is not None
    points = np.array([(_number(point, "x"), _number(point, "y")) for point in bound.findall("point")])
    return checked_line(points, 1e5, "a lanelet's bound")


def _obstacle(element: Element) -> _Obstacle:
    name = element.attrib["id"]
    length_m, width_m = _size(element.find("shape"))
    trajectory = element.find("trajectory")
    first = element.find("initialState")
    states = [first] if first is not None else []
    states += list(trajectory) if trajectory is not None else []
    return _Obstacle(name, np.array([_state(state) for state in states]), length_m, width_m)


def _size(shape: Element | None) -> tuple[float, float]:
    assert shape is not None
    rectangle, circle = shape.find("rectangle"), shape.find("circle")
    if rectangle is not None:
        return _number(rectangle, "length"), _number(rectangle, "width")
    if circle is not None:
        return 2.0 * _number(circle, "radius"), 2.0 * _number(circle, "radius")
    raise ValueError("an obstacle's shape is neither rectangle nor circle")


def _state(state: Element) -> tuple[float, float, float, float, float]:
    point = state.find("position/point")
    if point is None:
        raise ValueError("an obstacle's position is not a point")
    return (
        _number(state, "time/exact"),
        _number(point, "x"),
        _number(point, "y"),
        _number(state, "orientation/exact"),
        np.nan if state.find("velocity/exact") is None else _number(state, "velocity/exact"),
    )


def _number(element: Element, name: str) -> float:
    text = element.findtext(name)
    if text is None:
        raise ValueError(f"{element.tag} has no {name}")
    return number(text)


def _lasting(obstacle: _Obstacle, last: float) -> _Obstacle:
    steps = np.arange(0.0, last + 1.0)
    states = np.column_stack([steps, np.tile(obstacle.states[0, 1:], (len(steps), 1))])
    return _Obstacle(obstacle.name, states, obstacle.length_m, obstacle.width_m)
