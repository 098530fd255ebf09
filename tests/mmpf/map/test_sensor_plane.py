import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.sensor_plane import SensorPlane
from tests.mmpf.scenes import ROAD, ego_at

WINDING = CorridorRoad(
    ROAD.lanes, reference_xy=((-90.0, 40.0), (-20.0, 0.0), (30.0, 5.0), (120.0, 60.0)), reference_start_m=-80.0
)


def test_on_a_straight_road_the_plane_is_the_road_frame_shifted_to_the_sensor() -> None:
    plane = SensorPlane(ego_at(10.0, 2.0), ROAD)
    x, y = plane.seen_from_sensor(np.array([13.0, 10.0]), np.array([6.0, 2.0]))
    assert (x.tolist(), y.tolist()) == ([3.0, 0.0], [4.0, 0.0])
    assert plane.distance_m(np.array([13.0, 10.0]), np.array([6.0, 2.0])) == pytest.approx([5.0, 0.0])
    assert plane.heading_rad(np.array([13.0, 500.0])).tolist() == [0.0, 0.0]


@given(st.floats(-70.0, 110.0), st.floats(-70.0, 110.0), st.floats(-4.0, 9.0))
def test_on_a_winding_road_distances_and_directions_are_those_of_the_map(
    ego_lon: float, lon: float, lat: float
) -> None:
    ego = ego_at(ego_lon, 2.0)
    plane = SensorPlane(ego, WINDING)
    sensor, place, ahead = (
        np.array(WINDING.to_cartesian(np.array(at), np.array(beside)))
        for at, beside in ((ego_lon, 2.0), (lon, lat), (ego_lon + 1e-4, 2.0))
    )
    away, forward = place - sensor, (ahead - sensor) / np.hypot(*(ahead - sensor))
    x, y = plane.seen_from_sensor(np.array(lon), np.array(lat))
    assert plane.distance_m(np.array(lon), np.array(lat)) == pytest.approx(np.hypot(*away), abs=1e-9)
    assert x == pytest.approx(away @ forward, abs=1e-4)
    assert y == pytest.approx(away @ np.array([-forward[1], forward[0]]), abs=1e-4)
