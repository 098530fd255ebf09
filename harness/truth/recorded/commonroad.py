"""CommonRoad scenarios, versions 2018b and 2020a: obstacles' trajectories on their lanelets.

Lanelets that all lead one way are a road with a frame of its own; others, as at crossings, are lanes in the plane.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import BinaryIO
from xml.etree.ElementTree import Element, iterparse

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


@dataclass
class _Scenario:
    """What was found in the file so far."""

    step_s: float = 0.0
    lanelets: list[Lanelet] = field(default_factory=list)
    signs_at: dict[str, tuple[str, ...]] = field(default_factory=dict)
    signs: dict[str, dict[str, float | None]] = field(default_factory=dict)
    obstacles: list[_Obstacle] = field(default_factory=list)
    standing: list[_Obstacle] = field(default_factory=list)
    left_out: dict[str, int] = field(default_factory=dict)


def read_commonroad(path: Path) -> ReadTraffic:
    """Read a scenario.

    Positions are those of the obstacles' centres. A static obstacle stands there for the whole time. Pedestrians and
    bicycles are left out, and so are obstacles whose future is a set or a probability instead of a trajectory.

    Raises:
        InputError: The file is broken or has no lanelets or no vehicles.
    """
    scenario = _Scenario()
    with reading(path, f"CommonRoad scenario of version {' or '.join(VERSIONS)}"), unpacked(path) as file:
        _collect(file, path, scenario)
    if not scenario.lanelets:
        raise InputError(f"{path}: the scenario has no lanelets to take the road from")
    if not scenario.obstacles:
        raise InputError(f"{path}: the scenario has no vehicle with a trajectory")
    for what, ids in (
        ("lanelet", [each.name for each in scenario.lanelets]),
        ("obstacle", [each.name for each in (*scenario.obstacles, *scenario.standing)]),
    ):
        if len(set(ids)) < len(ids):
            raise InputError(f"{path}: {what} {max(ids, key=ids.count)} is there twice; remove one")
    for obstacle in (*scenario.obstacles, *scenario.standing):
        check_numbers(path, {"the time": obstacle.states[:, 0]}, TIMES, f"obstacle {obstacle.name}")
    last = max(obstacle.states[-1, 0] for obstacle in scenario.obstacles)
    standing = [_lasting(obstacle, last) for obstacle in scenario.standing]
    return _traffic(scenario, [*scenario.obstacles, *standing], path)


def _collect(file: BinaryIO, path: Path, scenario: _Scenario) -> None:
    depth = 0
    for event, element in iterparse(file, events=("start", "end")):
        depth += 1 if event == "start" else -1
        if event == "start" and depth == 1:
            _check_root(element, path)
            scenario.step_s = number(element.attrib["timeStepSize"])
            check_numbers(path, {"timeStepSize": scenario.step_s}, STEP, "")
        if event == "end" and depth == 1:
            _take(element, scenario)
            element.clear()


def _check_root(root: Element, path: Path) -> None:
    version = root.attrib.get("commonRoadVersion")
    if root.tag != "commonRoad" or version not in VERSIONS:
        raise InputError(f"{path}: CommonRoad version {version}; known are {' and '.join(VERSIONS)}")


def _take(element: Element, scenario: _Scenario) -> None:
    if element.tag == "lanelet" and element.find("leftBound") is not None:
        scenario.lanelets.append(_lanelet(element))
        scenario.signs_at[element.attrib["id"]] = _references(element, "trafficSignRef")
    elif element.tag == "trafficSign":
        scenario.signs[element.attrib["id"]] = _signs(element)
    elif element.tag in ("obstacle", "dynamicObstacle", "staticObstacle"):
        reason = _reason_to_leave_out(element)
        if reason is not None:
            scenario.left_out[reason] = scenario.left_out.get(reason, 0) + 1
        elif element.tag == "staticObstacle" or element.findtext("role") == "static":
            scenario.standing.append(_obstacle(element))
        else:
            scenario.obstacles.append(_obstacle(element))


def _reason_to_leave_out(element: Element) -> str | None:
    if (element.findtext("type") or "").strip() in ON_FOOT_OR_CYCLE:
        return "on foot or bicycle"
    if element.find("occupancySet") is not None or element.find("probabilityDistribution") is not None:
        return "without a trajectory"
    return None


def _lanelet(element: Element) -> Lanelet:
    return Lanelet(
        name=element.attrib["id"],
        left_xy=_points(element.find("leftBound")),
        right_xy=_points(element.find("rightBound")),
        successors=_references(element, "successor"),
        left=_neighbour(element.find("adjacentLeft")),
        right=_neighbour(element.find("adjacentRight")),
        speed_limit_mps=_positive(element.findtext("speedLimit")),
        kinds=tuple((kind.text or "").strip() for kind in element.findall("laneletType")),
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


def _signed(scenario: _Scenario) -> list[Lanelet]:
    """Return the lanelets with what the signs at them say."""
    lanelets = []
    for lanelet in scenario.lanelets:
        signs = [sign for ref in scenario.signs_at[lanelet.name] for sign in scenario.signs.get(ref, {}).items()]
        limits = [limit for kind, limit in signs if kind in LIMIT_SIGNS and limit is not None]
        lanelets.append(
            replace(
                lanelet,
                speed_limit_mps=min(limits) if limits else lanelet.speed_limit_mps,
                gives_way=any(kind in GIVE_WAY_SIGNS for kind, _ in signs),
            )
        )
    return lanelets


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


def _traffic(scenario: _Scenario, obstacles: list[_Obstacle], path: Path) -> ReadTraffic:
    states = np.concatenate([obstacle.states for obstacle in obstacles])
    vehicle = np.repeat(np.arange(len(obstacles)), [len(obstacle.states) for obstacle in obstacles])
    step, x, y, orientation, speed = states.T
    road, origin = road_of_lanelets(_signed(scenario), x, y, path)
    sizes = np.array([(obstacle.length_m, obstacle.width_m) for obstacle in obstacles])[vehicle]
    time_s, size_m = step * scenario.step_s, (sizes[:, 0], sizes[:, 1])
    rows = rows_in(road, origin, vehicle, time_s, (x, y, orientation), speed, size_m)
    read = len(obstacles) + sum(scenario.left_out.values())
    return ReadTraffic(road, np.array([obstacle.name for obstacle in obstacles]), rows, read, scenario.left_out)
