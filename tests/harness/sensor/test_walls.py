"""What buildings hide: against dense ray casting."""

from dataclasses import replace

import numpy as np
import pytest

from harness.sensor.detector import build_sensor
from harness.sensor.observation import Observation
from harness.sensor.profiles import sensor_settings
from harness.storage.schema import HIDDEN, VISIBLE
from harness.truth.frame import Frame
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.numerics.arrays import FloatArray
from tests.harness.sensor.sensor_scenes import frame_of
from tests.mmpf.map.scenes import graph_of

GRAPH = graph_of({"there": [(-300, 0), (300, 0)]})
RAYS = 40_000


def in_the_plane(places: list[tuple[float, float]], headings: list[float]) -> Frame:
    """An ego at the origin and cars around it."""
    frame = frame_of(*places)
    x, y = np.array([(0.0, 0.0), *places]).T
    return replace(frame, lon_m=x, lat_m=y, heading_rad=np.array([0.0, *headings]))


def look(frame: Frame, walls: FloatArray) -> Observation:
    sensor = build_sensor(sensor_settings("ideal", {}))
    return sensor.observe(frame, LaneGraphRoad(graph=GRAPH, walls_xy=walls), np.random.default_rng(0))


def traced(frame: Frame, walls: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shares of the rays through each car that meet nothing before it, and that meet a wall first."""
    angles = (np.arange(RAYS) + 0.5) * 2.0 * np.pi / RAYS
    ray = np.stack([np.cos(angles), np.sin(angles)])

    def entry(x: float, y: float, heading: float, length: float, width: float) -> FloatArray:
        turn = np.array([[np.cos(heading), np.sin(heading)], [-np.sin(heading), np.cos(heading)]])
        centre, direction = turn @ [x, y], turn @ ray
        half = 0.5 * np.array([length, width])[:, None]
        near, far = (centre[:, None] - half) / direction, (centre[:, None] + half) / direction
        enter, leave = np.minimum(near, far).max(axis=0), np.maximum(near, far).min(axis=0)
        return np.where((enter <= leave) & (enter > 0.0), enter, np.inf)

    cars = [
        entry(*each)
        for each in np.stack([frame.lon_m, frame.lat_m, frame.heading_rad, frame.length_m, frame.width_m])[:, 1:].T
    ]
    stone = np.full(RAYS, np.inf)
    for x0, y0, x1, y1 in walls:
        cross = ray[0] * (y1 - y0) - ray[1] * (x1 - x0)
        away = (x0 * (y1 - y0) - y0 * (x1 - x0)) / cross
        share = (x0 * ray[1] - y0 * ray[0]) / cross
        stone = np.minimum(stone, np.where((away > 0.0) & (share >= 0.0) & (share <= 1.0), away, np.inf))
    surfaces = np.stack([*cars, stone])
    nearest = surfaces.min(axis=0)
    seen = np.array([np.mean((each <= nearest)[np.isfinite(each)]) for each in cars])
    return seen, np.array([np.mean(((stone <= nearest) & (stone < each))[np.isfinite(each)]) for each in cars])


def test_a_car_behind_a_building_is_hidden_and_one_beside_it_is_not() -> None:
    walls = np.array(
        [[10.0, -4.0, 10.0, 4.0], [10.0, 4.0, 30.0, 4.0], [30.0, 4.0, 30.0, -4.0], [30.0, -4.0, 10.0, -4.0]]
    )
    seen = look(in_the_plane([(50.0, 0.0), (20.0, 25.0)], [0.0, 1.0]), walls)
    assert seen.state[1:].tolist() == [HIDDEN, VISIBLE]
    assert seen.occluder.tolist() == [-1, -1, -1]
    assert seen.behind_walls.tolist() == [0.0, 1.0, 0.0]
    assert len(seen.scan.detections) == 1


def test_a_lorry_before_a_building_is_what_hides() -> None:
    walls = np.array([[40.0, -9.0, 40.0, 9.0]])
    seen = look(in_the_plane([(10.0, 0.0), (60.0, 0.0)], [0.5 * np.pi, 0.0]), walls)
    assert (seen.state[2], seen.occluder[2], seen.behind_walls[2]) == (HIDDEN, 1, 0.0)


def test_a_road_without_walls_tells_nothing_of_them() -> None:
    sensor = build_sensor(sensor_settings("ideal", {}))
    frame = in_the_plane([(10.0, 0.0)], [0.0])
    assert sensor.observe(frame, LaneGraphRoad(graph=GRAPH), np.random.default_rng(0)).behind_walls is None


@pytest.mark.parametrize("seed", range(12))
def test_shadows_of_walls_and_cars_together_are_those_of_dense_ray_casting(seed: int) -> None:
    rng = np.random.default_rng(seed)
    distance, bearing = rng.uniform(12.0, 70.0, 9), rng.uniform(-np.pi, np.pi, 9)
    frame = in_the_plane(
        list(zip(distance * np.cos(bearing), distance * np.sin(bearing), strict=True)), list(rng.uniform(-3.0, 3.0, 9))
    )
    start = rng.uniform(-60.0, 60.0, (6, 2))
    start += 8.0 * np.sign(start)
    walls = np.concatenate([start, start + rng.uniform(-15.0, 15.0, (6, 2))], axis=1)
    found = look(frame, walls)
    seen, behind_walls = traced(frame, walls)
    assert found.visible_fraction[1:] == pytest.approx(seen, abs=0.01)
    assert found.behind_walls[1:] == pytest.approx(behind_walls, abs=0.01)
