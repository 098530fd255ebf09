"""Small scenes on roads whose frame is the plane: cars that follow lanes around a bend and across a crossing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness.trackers.conformance.scripted_scenes import (
    LENGTH_M,
    STD_LAT_M,
    STD_LON_M,
    WIDTH_M,
    LabelledScan,
    detections_at,
    shuffled,
)
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray
from mmpf.scan import EgoPose, Scan

LANE_WIDTH_M, SPEED_LIMIT_MPS = 3.2, 20.0
BEND_RADIUS_M, BEND_RAD = 100.0, 0.75 * np.pi
ARM_M, TURN_RADIUS_M, POINTS = 120.0, 10.0, 40


@dataclass(frozen=True)
class CarOnLine:
    """A car that follows a line through the plane at constant speed.

    Attributes:
        line: Points of the line, metres, shape (p, 2).
        start_m: How far along the line its middle is at time zero.
    """

    name: str
    line: FloatArray
    start_m: float
    speed_mps: float

    def place_at(self, time_s: float) -> tuple[float, float]:
        """Return x and y of its middle at a time, metres."""
        x, y, _ = self.pose_at(time_s)
        return x, y

    def pose_at(self, time_s: float) -> tuple[float, float, float]:
        """Return x and y of its middle, metres, and its heading, radians."""
        step = np.diff(self.line, axis=0)
        along = np.concatenate([[0.0], np.cumsum(np.hypot(step[:, 0], step[:, 1]))])
        at_m = self.start_m + self.speed_mps * time_s
        x, y = (float(np.interp(at_m, along, self.line[:, axis])) for axis in (0, 1))
        piece = int(np.clip(np.searchsorted(along, at_m, side="right") - 1, 0, len(step) - 1))
        return x, y, float(np.arctan2(step[piece, 1], step[piece, 0]))


def bend_scene() -> tuple[Road, list[CarOnLine], CarOnLine]:
    """Return two lanes that turn left by 135 degrees within 100 m, four cars on them, and the ego between these."""
    angle = np.linspace(0.0, BEND_RAD, POINTS)
    lines = {}
    for name, radius_m in (
        ("inner", BEND_RADIUS_M - 0.5 * LANE_WIDTH_M),
        ("outer", BEND_RADIUS_M + 0.5 * LANE_WIDTH_M),
    ):
        arc = np.stack([radius_m * np.sin(angle), BEND_RADIUS_M - radius_m * np.cos(angle)], axis=-1)
        before = arc[0] - [ARM_M, 0.0]
        after = arc[-1] + ARM_M * np.array([np.cos(BEND_RAD), np.sin(BEND_RAD)])
        lines[name] = np.concatenate([before[None], arc, after[None]])
    inner, outer = lines["inner"], lines["outer"]
    cars = [
        CarOnLine("inside ahead", inner, ARM_M + 45.0, 10.0),
        CarOnLine("outside ahead", outer, ARM_M + 15.0, 11.0),
        CarOnLine("inside behind", inner, ARM_M - 45.0, 9.0),
        CarOnLine("outside behind", outer, ARM_M - 70.0, 10.0),
    ]
    road = LaneGraphRoad(section_m=(-300.0, 300.0), graph=_graph(lines, {}, (("outer", "inner"),)))
    return road, cars, CarOnLine("ego", inner, ARM_M, 10.0)


def crossing_scene() -> tuple[Road, list[CarOnLine], CarOnLine]:
    """Return two roads that cross, cars that cross, turn left and come towards the ego, and the ego that waits."""
    half = 0.5 * LANE_WIDTH_M
    east, north = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    lines, follow = {}, {}
    for name, ahead in (("east", east), ("west", -east), ("north", north), ("south", -north)):
        right = np.array([ahead[1], -ahead[0]])
        stop, leave = half * right - TURN_RADIUS_M * ahead, half * right + TURN_RADIUS_M * ahead
        lines[f"{name} in"] = np.stack([stop - ARM_M * ahead, stop])
        lines[f"{name} out"] = np.stack([leave, leave + ARM_M * ahead])
        lines[f"{name} across"] = np.stack([stop, leave])
        follow[f"{name} in"], follow[f"{name} across"] = [f"{name} across"], [f"{name} out"]
    # From the west to the north: a quarter of a circle around the corner on the left.
    radius_m, angle = TURN_RADIUS_M + half, np.linspace(0.0, 0.5 * np.pi, POINTS)
    corner = np.array([-TURN_RADIUS_M, TURN_RADIUS_M])
    lines["east to north"] = corner + radius_m * np.stack([np.sin(angle), -np.cos(angle)], axis=-1)
    follow["east in"].append("east to north")
    follow["east to north"] = ["north out"]

    def way(*names: str) -> FloatArray:
        return np.concatenate([lines[names[0]], *(lines[name][1:] for name in names[1:])])

    def straight(name: str) -> FloatArray:
        return way(f"{name} in", f"{name} across", f"{name} out")

    turning = way("east in", "east to north", "north out")
    cars = [
        CarOnLine("turning left", turning, ARM_M - 5.0, 5.0),
        CarOnLine("from the south", straight("north"), ARM_M - 55.0, 12.0),
        CarOnLine("oncoming", straight("west"), ARM_M - 50.0, 14.0),
        CarOnLine("from the north", straight("south"), ARM_M + 35.0, 10.0),
    ]
    road = LaneGraphRoad(section_m=(-150.0, 150.0), graph=_graph(lines, follow, ()))
    return road, cars, CarOnLine("ego", straight("east"), ARM_M - 15.0, 0.0)


def scans_in_plane(
    cars: Sequence[CarOnLine], ego: CarOnLine, times_s: Sequence[float], rng: np.random.Generator
) -> list[LabelledScan]:
    """Return scans of the cars from a sensor without occlusion that misses one detection in twenty."""
    scans = []
    for time_s in times_s:
        seen = [car for car in cars if rng.random() < 0.95]
        places = np.array([car.place_at(time_s) for car in seen]).reshape(-1, 2)
        noise = rng.normal(0.0, (STD_LON_M, STD_LAT_M), places.shape)
        x, y = (places + noise).T
        pose = EgoPose(*ego.pose_at(time_s), ego.speed_mps, LENGTH_M, WIDTH_M)
        labelled = LabelledScan(
            Scan(float(time_s), detections_at(x, y), pose), np.array([car.name for car in seen], dtype=np.str_)
        )
        scans.append(shuffled(labelled, rng.permutation(len(seen))))
    return scans


def _graph(
    lines: Mapping[str, FloatArray], follow: Mapping[str, Sequence[str]], beside: Sequence[tuple[str, str]]
) -> LaneGraph:
    """Return the graph of lanes along lines; in ``beside`` the second of a pair is the first one's left neighbour."""
    names = tuple(lines)
    index = {name: k for k, name in enumerate(names)}
    left, right = np.full(len(names), NOWHERE), np.full(len(names), NOWHERE)
    for lower, upper in beside:
        left[index[lower]], right[index[upper]] = index[upper], index[lower]
    following = [[index[to] for to in follow.get(name, ())] for name in names]
    return LaneGraph(
        name=names,
        xy=np.concatenate(list(lines.values())),
        first_point=np.cumsum([0, *map(len, lines.values())]),
        width_m=np.full(len(names), LANE_WIDTH_M),
        speed_limit_mps=np.full(len(names), SPEED_LIMIT_MPS),
        left=left,
        right=right,
        successor=np.array([to for each in following for to in each], dtype=np.int64),
        first_successor=np.cumsum([0, *map(len, following)]),
        in_junction=np.array([name.endswith("across") or " to " in name for name in names]),
    )
