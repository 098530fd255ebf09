"""The relation between density, speed and flow, and what a density asks for."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.common.errors import InputError
from harness.truth.network.demand import VEHICLE_LENGTH_M, Drivers, demand_for_density

densities = st.floats(5.0, 65.0)


@given(densities, densities)
def test_denser_traffic_is_never_faster(first, second):
    drivers = Drivers()
    slow, fast = drivers.speed_mps(max(first, second)), drivers.speed_mps(min(first, second))
    assert slow <= fast <= drivers.free_speed_mps


@given(st.floats(1.0, 25.0))
def test_congested_speed_is_the_one_at_which_the_gaps_leave_room_for_the_flow(speed):
    drivers = Drivers()
    spacing = VEHICLE_LENGTH_M + drivers.minimum_gap_m + drivers.headway_s * speed
    assert drivers.congested_speed_mps(speed / spacing) == pytest.approx(speed)


@pytest.mark.parametrize("density", [0.0, -1.0, 4.99, 65.01, 500.0, math.nan, math.inf])
def test_a_density_out_of_range_is_refused_by_name(density):
    with pytest.raises(InputError, match="`density`"):
        demand_for_density(density)


@given(densities)
def test_ramps_carry_what_the_site_saw_and_no_more(density):
    demand = demand_for_density(density)
    assert 0.0 < demand.on_ramp_veh_per_h <= 600.0
    assert 0.0 < demand.off_ramp_veh_per_h <= 380.0
    assert 0.0 <= demand.wave_amplitude < 1.0


def test_free_traffic_has_no_waves_and_a_jam_has():
    assert demand_for_density(10.0).wave_amplitude == 0.0
    assert demand_for_density(50.0).wave_amplitude > 0.3
