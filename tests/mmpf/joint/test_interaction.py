"""Room beside seen vehicles: what a hidden particle loses by standing where another vehicle is."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import component_moments
from mmpf.joint.interaction import room_beside_seen_vehicles
from mmpf.map.sensor_plane import SensorPlane
from mmpf.numerics.arrays import FloatArray
from tests.mmpf.scenes import ROAD, belief_of, ego_at, spot

SEEN_LON_M, SEEN_LAT_M = 40.0, 5.0
LENGTH_M, WIDTH_M = 6.0, 2.0


def hidden_beside_seen(along_m: float, across_m: float, seen_is_confirmed: bool = True) -> Mixture:
    return belief_of(
        [spot(SEEN_LON_M + along_m, SEEN_LAT_M + across_m, particles=4), spot(SEEN_LON_M, SEEN_LAT_M, particles=3)],
        confirmed=[True, seen_is_confirmed],
        length_m=[4.7, LENGTH_M],
        width_m=[1.9, WIDTH_M],
    )


def factors(mixture: Mixture, strength: float, is_seen: tuple[bool, bool] = (False, True)) -> FloatArray:
    far_ego = ego_at(lon_m=-500.0)
    plane = SensorPlane(far_ego, ROAD)
    return room_beside_seen_vehicles(mixture, component_moments(mixture), np.array(is_seen), plane, strength)


@pytest.mark.parametrize("strength", [0.0, 0.1, 0.9, 3.0])
def test_right_on_a_seen_vehicle_the_exponent_is_the_strength_and_the_seen_one_loses_nothing(strength: float) -> None:
    assert factors(hidden_beside_seen(0.0, 0.0), strength) == pytest.approx([np.exp(-strength)] * 4 + [1.0] * 3)


@given(st.floats(-8.0, 8.0), st.floats(-3.5, 3.5), st.floats(0.05, 2.0))
@settings(deadline=None)
def test_what_is_lost_falls_with_the_fourth_power_of_the_distance_in_footprints(
    along_m: float, across_m: float, strength: float
) -> None:
    along, across = along_m / (0.5 * LENGTH_M), across_m / (0.63 * WIDTH_M)
    overlap = np.exp(-0.5 * (along**4 + across**4))
    found = factors(hidden_beside_seen(along_m, across_m), strength)[0]
    assert found == pytest.approx(np.exp(-strength * overlap), abs=1e-3), "beyond two scales it may be left out"
    assert found <= 1.0


def test_every_seen_vehicle_counts_the_ego_among_them() -> None:
    mixture = hidden_beside_seen(0.0, 0.0)
    ego = ego_at(lon_m=SEEN_LON_M, lat_m=SEEN_LAT_M)
    is_seen, plane = np.array([False, True]), SensorPlane(ego, ROAD)
    factor = room_beside_seen_vehicles(mixture, component_moments(mixture), is_seen, plane, 0.5)
    assert factor[:4] == pytest.approx([np.exp(-1.0)] * 4)


def test_a_component_that_is_not_confirmed_or_not_seen_claims_no_room() -> None:
    assert factors(hidden_beside_seen(0.0, 0.0, seen_is_confirmed=False), 0.9).tolist() == [1.0] * 7
    assert factors(hidden_beside_seen(0.0, 0.0), 0.9, is_seen=(False, False)).tolist() == [1.0] * 7
    assert factors(hidden_beside_seen(0.0, 0.0), 0.9, is_seen=(True, True)).tolist() == [1.0] * 7
