from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import LineString, Point, box

from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.road import Road
from mmpf.map.sensor_plane import SensorPlane
from mmpf.numerics.arrays import FloatArray
from mmpf.options.filter import MEAN_CAR
from mmpf.scan import EgoPose, FreeSpace
from mmpf.visibility.depth import BEARINGS, Occluders, depth_table
from mmpf.visibility.shadows import shadowed_share, visible_fractions
from tests.mmpf.map.scenes import graph_of
from tests.mmpf.scenes import ROAD, ego_at, lane_centre

PLANE = SensorPlane(ego_at(), ROAD)


def cars(count: int) -> Occluders:
    return Occluders(np.full(count, MEAN_CAR.length_m), np.full(count, MEAN_CAR.width_m))


def traced(places: FloatArray, heading: FloatArray, bodies: Occluders, rays: int = 4000) -> FloatArray:
    """Share of the rays to points on each vehicle's silhouette that meet no nearer vehicle, ray by ray.

    The vehicles are at places (2, n) in the plane as seen from its origin, and point where they point.
    """
    halves = 0.5 * np.stack([bodies.length_m, bodies.width_m], axis=-1)
    signs = np.array([(sx, sy) for sx in (-1, 1) for sy in (-1, 1)])
    turns = np.array([[[np.cos(h), -np.sin(h)], [np.sin(h), np.cos(h)]] for h in heading])
    result = np.empty(places.shape[1])
    for k in range(len(result)):
        corners = signs * halves[k] @ turns[k].T
        centre = places[:, k]
        bearings = np.arctan2(*(centre + corners).T[::-1])
        middle = np.arctan2(centre[1], centre[0])
        relative = np.mod(bearings - middle + np.pi, 2 * np.pi) - np.pi
        angle = middle + np.linspace(relative.min(), relative.max(), rays)
        direction = np.stack([np.cos(angle), np.sin(angle)])
        blocked = np.zeros(rays, dtype=np.bool_)
        for other in range(len(result)):
            if other == k:
                continue
            # In the other's own frame it lies along the axes.
            box, turned = (turns[other].T @ places[:, other])[:, None], turns[other].T @ direction
            half = halves[other][:, None]
            near, far = (box - half) / turned, (box + half) / turned
            enter, leave = np.minimum(near, far).max(axis=0), np.maximum(near, far).min(axis=0)
            blocked |= (enter <= leave) & (enter > 0.0) & (enter < np.hypot(*centre))
        result[k] = 1.0 - blocked.mean()
    return result


def test_the_sensors_own_free_space_asserts_occlusion() -> None:
    sectors = np.full(720, 100.0)
    sectors[350:370] = 30.0
    share = shadowed_share(
        PLANE,
        np.array([20.0, 60.0, 60.0]),
        np.array([lane_centre(2)] * 2 + [lane_centre(2) + 40.0]),
        cars(3),
        FreeSpace(sectors),
    )
    assert share == pytest.approx([0.0, 1.0, 0.0])


@pytest.mark.parametrize(("middle_m", "hidden"), [(29.0, 0.0), (31.0, 1.0)])
def test_a_vehicle_is_covered_from_where_its_middle_passes_the_free_distance(middle_m: float, hidden: float) -> None:
    ahead = np.array([middle_m]), np.array([lane_centre(2)])
    for length_m in (4.7, 18.0):
        bodies = Occluders(np.array([length_m]), np.array([1.9]))
        assert shadowed_share(PLANE, *ahead, bodies, FreeSpace(np.full(720, 30.0))) == pytest.approx([hidden])


@pytest.mark.parametrize("sectors_turned", [0, 90, 333, -200])
def test_what_the_sensor_covers_does_not_depend_on_where_the_road_leads(sectors_turned: int) -> None:
    rng = np.random.default_rng(0)
    lon, lat = rng.uniform(-80.0, 80.0, 40), rng.uniform(-15.0, 30.0, 40)
    bodies = Occluders(rng.uniform(3.5, 15.0, 40), rng.uniform(1.6, 2.6, 40))
    free_m = np.repeat(rng.uniform(5.0, 80.0, 72), 10)
    straight = shadowed_share(PLANE, lon, lat, bodies, FreeSpace(free_m))
    turn_rad = 2.0 * np.pi * sectors_turned / 720
    turned_road = replace(ROAD, reference_xy=((3.0, -7.0), (3.0 + np.cos(turn_rad), -7.0 + np.sin(turn_rad))))
    plane = SensorPlane(ego_at(), turned_road)
    turned = shadowed_share(plane, lon, lat, bodies, FreeSpace(np.roll(free_m, sectors_turned)))
    assert turned == pytest.approx(straight)
    assert 0.2 < straight.mean() < 0.8


@given(st.integers(0, 10_000), st.sampled_from([None, 60.0, 100.0, 400.0, -100.0]))
@settings(max_examples=50, deadline=None, derandomize=True)
def test_the_table_agrees_with_ray_tracing_on_straight_roads_and_bends(seed: int, radius_m: float | None) -> None:
    rng = np.random.default_rng(seed)
    road, near_m, beside = (ROAD, 6.0, 1) if radius_m is None else (bend(radius_m), 8.0, 2)
    lane = rng.integers(0, 5, 12)
    lon = np.arange(12) * 12.0 - 70.0 + rng.uniform(-2.0, 2.0, 12)
    keep = ~((np.abs(lon) < near_m) & (np.abs(lane - 2) < beside))
    lon, lat = lon[keep], np.array([lane_centre(k) for k in lane[keep]])
    bodies = Occluders(rng.uniform(3.5, 8.0, len(lon)), rng.uniform(1.6, 2.6, len(lon)))
    plane = SensorPlane(ego_at(), road)
    table = depth_table(plane, lon, lat, np.ones(len(lon), dtype=np.bool_), bodies)
    found = visible_fractions(plane, lon, lat, np.arange(len(lon)), bodies, table)
    sensor = np.stack(road.to_cartesian(np.array([0.0]), np.array([ego_at().lat_m])))
    places = np.stack(road.to_cartesian(lon, lat)) - sensor
    difference = np.abs(found - traced(places, road.heading_at(lon), bodies))
    assert difference.max() < 0.25
    assert difference.mean() < 0.05


def bend(radius_m: float) -> Road:
    """The test road, laid along a circle to the left (to the right if negative) that begins far behind the sensor."""
    angle = np.arange(-150.0, 150.0) / radius_m + 0.3
    circle = radius_m * np.stack([np.sin(angle), -np.cos(angle)], axis=-1)
    return replace(ROAD, reference_xy=tuple(map(tuple, circle.tolist())), reference_start_m=-150.0)


@pytest.mark.parametrize("spread_m", [0.05, 1.0, 8.0])
def test_visible_fractions_are_those_of_each_particle_ray_by_ray(spread_m: float):
    rng = np.random.default_rng(3)
    components, particles = 30, 40
    centre = np.stack([rng.uniform(-80.0, 80.0, components), rng.uniform(0.0, 18.0, components)])
    component = np.repeat(np.arange(components), particles)
    lon_m, lat_m = centre[:, component] + rng.normal(0.0, spread_m, (2, len(component)))
    ego = ego_at(0.0)
    bodies = Occluders(rng.uniform(3.0, 20.0, components), rng.uniform(1.5, 2.6, components))
    table = depth_table(PLANE, centre[0], centre[1], rng.random(components) < 0.7, bodies)
    found = visible_fractions(PLANE, lon_m, lat_m, component, bodies, table)
    sectors = table.depth_m.shape[1]
    for n in range(len(component)):
        x, y = lon_m[n] - ego.lon_m, lat_m[n] - ego.lat_m
        distance = np.hypot(x, y)
        length, width = bodies.length_m[component[n]], bodies.width_m[component[n]]
        half = np.arctan2(0.5 * (length * abs(y) + width * abs(x)) / distance, distance)
        rays = min(max(int(2.0 * half / (2.0 * np.pi / sectors)), 3), 16)
        bearings = np.arctan2(y, x) + half * ((2.0 * np.arange(rays) + 1.0) / rays - 1.0)
        sector = np.floor((bearings + np.pi) / (2.0 * np.pi) * sectors).astype(int) % sectors
        own = table.caster[0, sector] == component[n]
        surface = np.where(own, table.depth_m[1, sector], table.depth_m[0, sector])
        assert found[n] == pytest.approx((surface >= distance).mean(), abs=1e-12)


@pytest.mark.parametrize(
    ("first_casts", "wall", "fraction"),
    [
        (False, (20, -1, 20, 9), 0.0),
        (True, (20, 5, 20, 9), 0.0),
        (False, (20, 5, 20, 9), 1.0),
        (False, (35, -9, 35, 9), 1.0),
    ],
)
def test_a_vehicle_is_hidden_by_a_wall_before_it_or_a_vehicle_before_it_and_by_nothing_else(
    first_casts: bool, wall: tuple[float, ...], fraction: float
) -> None:
    graph = graph_of({"there": [(-200, 0), (200, 0)]})
    road = LaneGraphRoad(graph=graph, walls_xy=np.array([wall], dtype=float))
    plane = SensorPlane(EgoPose(0.0, 0.0, 0.0, 0.0, 4.7, 1.9), road)
    lon, lat = np.array([10.0, 30.0]), np.zeros(2)
    table = depth_table(plane, lon, lat, np.array([first_casts, True]), cars(2))
    found = visible_fractions(plane, lon, lat, np.arange(2), cars(2), table)
    assert found == pytest.approx([1.0, fraction], abs=0.01)


def test_crossing_vehicles_hide_each_other_by_the_sides_that_they_show() -> None:
    graph = graph_of({"there": [(-200, 0), (200, 0)]})
    plane = SensorPlane(EgoPose(0.0, 0.0, 0.0, 0.0, 4.7, 1.9), LaneGraphRoad(graph=graph))
    rng = np.random.default_rng(0)
    for _ in range(20):
        lon, lat = np.array([20.0, 40.0]), rng.uniform(-1.5, 1.5, 2)
        bodies = Occluders(np.array([8.0, 5.0]), np.array([2.0, 1.8]), rng.uniform(-np.pi, np.pi, 2))
        table = depth_table(plane, lon, lat, np.ones(2, dtype=np.bool_), bodies)
        found = visible_fractions(plane, lon, lat, np.arange(2), bodies, table)
        assert found == pytest.approx(traced(np.stack([lon, lat]), bodies.turn_rad, bodies), abs=0.12)


def nearest_two(places: FloatArray, bodies: Occluders, bearing: float) -> list[float]:
    """Return the distances at which a ray meets the two nearest bodies that point along x, by shapely."""
    ray = LineString([(0.0, 0.0), (200.0 * np.cos(bearing), 200.0 * np.sin(bearing))])
    boxes = (
        box(x - 0.5 * length, y - 0.5 * width, x + 0.5 * length, y + 0.5 * width)
        for x, y, length, width in zip(*places, bodies.length_m, bodies.width_m, strict=True)
    )
    return sorted(Point(0.0, 0.0).distance(ray.intersection(each)) for each in boxes if ray.intersects(each))[:2]


def test_a_sector_knows_the_near_sides_of_the_two_nearest_bodies_along_its_middle():
    lon_m, lat_m = np.array([20.0, 40.0, 60.0, 25.0]), lane_centre(2) + np.array([0.0, 0.5, 1.0, 8.0])
    table = depth_table(PLANE, lon_m, lat_m, np.ones(4, dtype=np.bool_), cars(4))
    places = np.stack(PLANE.seen_from_sensor(lon_m, lat_m))
    for sector in range(BEARINGS):
        expected = nearest_two(places, cars(4), -np.pi + (sector + 0.5) * 2.0 * np.pi / BEARINGS)
        assert table.depth_m[:, sector] == pytest.approx([*expected, np.inf, np.inf][:2], abs=1e-6)
