"""The road frame of a bent reference line has neither gaps nor overlaps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmpf.map.corridor_road import CorridorRoad, highway
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map
from mmpf.map.road import Road


def bent_road(turns_rad: list[float], piece_m: float = 40.0) -> Road:
    headings = np.cumsum([0.3, *turns_rad])
    steps = piece_m * np.column_stack([np.cos(headings), np.sin(headings)])
    vertices = np.vstack([[5.0, -7.0], np.array([5.0, -7.0]) + np.cumsum(steps, axis=0)])
    return CorridorRoad(lanes=(), reference_xy=tuple(map(tuple, vertices.tolist())), reference_start_m=-20.0)


@given(
    st.lists(st.floats(-0.2, 0.2), min_size=1, max_size=6),
    st.lists(st.tuples(st.floats(-100.0, 350.0), st.floats(-15.0, 15.0)), min_size=1, max_size=20),
)
def test_every_position_near_a_bent_road_maps_to_the_plane_and_back(turns, positions):
    road = bent_road(turns)
    lon, lat = np.array(positions).T
    back_lon, back_lat = road.to_road(*road.to_cartesian(lon, lat))
    np.testing.assert_allclose(back_lon, lon, atol=1e-6)
    np.testing.assert_allclose(back_lat, lat, atol=1e-6)


@given(st.lists(st.floats(-0.2, 0.2), min_size=1, max_size=6), st.floats(-15.0, 15.0))
def test_driving_parallel_to_a_bent_road_never_jumps(turns, lat):
    road = bent_road(turns)
    lon = np.arange(-60.0, 40.0 * (len(turns) + 1) + 40.0, 0.1)
    x, y = road.to_cartesian(lon, np.full_like(lon, lat))
    steps = np.hypot(np.diff(x), np.diff(y))
    # A parallel's length differs from the line's by at most the turn times its distance, spread over a piece.
    assert np.all(np.abs(steps - 0.1) < 0.1 * 15.0 * 0.21 * 1.01 / 40.0 * 2.0)


def test_lateral_position_is_the_distance_from_the_line():
    road = bent_road([0.1, -0.15])
    x, y = road.to_cartesian(np.array([10.0, 45.0]), np.array([3.0, -4.0]))
    vertices = np.array(road.reference_xy)
    for k, distance in enumerate((3.0, 4.0)):
        starts, ends = vertices[:-1], vertices[1:]
        along = np.einsum("ij,ij->i", np.array([x[k], y[k]]) - starts, ends - starts) / 40.0**2
        nearest = starts + np.clip(along, 0.0, 1.0)[:, None] * (ends - starts)
        assert np.min(np.hypot(*(np.array([x[k], y[k]]) - nearest).T)) == pytest.approx(distance)


def test_a_straight_road_maps_exactly():
    lon, lat = np.random.default_rng(0).uniform(-50.0, 700.0, (2, 200))
    road = highway()
    np.testing.assert_array_equal(road.to_cartesian(lon, lat), (lon, lat))
    np.testing.assert_array_equal(road.to_road(lon, lat), (lon, lat))


def test_without_a_map_a_road_has_no_lanes():
    assert list(LaneGraphRoad(without_map()).lines()) == []
