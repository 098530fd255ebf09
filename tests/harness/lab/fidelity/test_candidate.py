"""How the calibration moves its parameters, on figures that are made up."""

import math
from dataclasses import replace

import pytest

from harness.lab.fidelity.candidate import (
    as_table,
    averaged,
    first_candidate,
    improved,
    misfit,
    with_bolder_drivers,
    write_candidate,
)
from harness.lab.fidelity.measured import MeasuredVehicles, read_measured
from harness.lab.fidelity.samples import VehicleStatistics
from harness.lab.fidelity.statistics import PeriodStatistics
from harness.truth.network.network import load_network
from harness.truth.network.networkfile import CalibrationFile, file_of

NAMES = ("us101-0750", "us101-0805", "us101-0820")


@pytest.fixture(scope="module")
def network():
    return load_network("us101")


@pytest.fixture(scope="module")
def site(network):
    return read_measured(network)


@pytest.fixture
def candidate(network, site):
    return first_candidate(network, site, NAMES)


def as_measured(site):
    return {name: site.periods[name].statistics for name in NAMES}


def test_the_first_candidate_has_the_measured_densities_and_a_headway_that_carries_the_flow(candidate, site):
    drivers = candidate.drivers
    for name in NAMES:
        measured, demand = site.periods[name], candidate.demands[name]
        densities = [part.density_veh_per_km_lane for part in measured.parts]
        assert [density for _, density, _ in demand.schedule] == pytest.approx(densities, abs=0.01)
        assert [start for start, _, _ in demand.schedule] == [0.0, 300.0, 600.0]
        assert max(waves for _, _, waves in demand.schedule) == 1.0
        spacing_m = 4.64 + drivers.minimum_gap_m + drivers.headway_s * measured.statistics.mean_speed_mps
        assert 1000.0 / spacing_m == pytest.approx(measured.statistics.density_veh_per_km_lane, rel=0.02)


def test_what_fits_is_left_as_it_is(candidate, site):
    moved = improved(candidate, as_measured(site), site, 1.0)
    assert moved.drivers.headway_s == pytest.approx(candidate.drivers.headway_s, rel=1e-3)
    assert moved.drivers.minimum_gap_m == pytest.approx(candidate.drivers.minimum_gap_m, rel=1e-3)
    for name in NAMES:
        assert moved.demands[name].exit_wave_amplitude == pytest.approx(candidate.demands[name].exit_wave_amplitude)
        for (_, before), (_, after) in zip(
            candidate.demands[name].headway_profile, moved.demands[name].headway_profile, strict=True
        ):
            assert after == pytest.approx(before, rel=1e-3)
    assert misfit(as_measured(site), site) == 0.0


def test_traffic_that_is_too_fast_at_its_density_is_given_longer_headways_there(candidate, site):
    figures = as_measured(site)
    fast = figures[NAMES[0]]
    faster = tuple(1.1 * v if k == 3 else v for k, v in enumerate(fast.quarter_speed_mps))
    more = tuple(1.1 * q if k == 3 else q for k, q in enumerate(fast.quarter_flow_veh_per_h))
    figures[NAMES[0]] = replace(fast, quarter_speed_mps=faster, quarter_flow_veh_per_h=more)
    moved = improved(candidate, figures, site, 1.0)

    def own(entry, name):
        return [entry.drivers.headway_s * factor for _, factor in entry.demands[name].headway_profile[:4]]

    before, after = own(candidate, NAMES[0]), own(moved, NAMES[0])
    assert after[3] == pytest.approx(1.1 * before[3], rel=2e-3)
    assert after[:3] == pytest.approx(before[:3], rel=2e-3)
    assert own(moved, NAMES[1]) == pytest.approx(own(candidate, NAMES[1]), rel=2e-3)


@pytest.mark.parametrize("lanes", [2, 5])
def test_half_the_flow_in_a_quarter_asks_for_the_headway_of_twice_the_spacing(candidate, site, lanes):
    flow = lanes * 3.6 * 10.0 * 40.0
    even = PeriodStatistics(10.0, flow, 40.0, (10.0,) * 4, (flow,) * 4, 0.1, 5.5)
    halved = replace(even, quarter_flow_veh_per_h=(flow, flow, flow, 0.5 * flow))
    periods = {NAMES[0]: site.periods[NAMES[0]].model_copy(update={"statistics": halved})}
    moved = improved(candidate, {NAMES[0]: even}, site.model_copy(update={"periods": periods}), 0.3)
    factors = [factor for _, factor in moved.demands[NAMES[0]].headway_profile]
    standing_m = candidate.drivers.standing_spacing_m
    assert factors[3] / factors[0] == pytest.approx(((50.0 - standing_m) / (25.0 - standing_m)) ** 0.3, rel=1e-3)


def test_the_local_factors_have_a_mean_of_one_over_periods_and_places(candidate, site):
    figures = {name: replace(entry, mean_speed_mps=1.2 * entry.mean_speed_mps,
                             quarter_speed_mps=tuple(1.2 * v for v in entry.quarter_speed_mps))
               for name, entry in as_measured(site).items()}  # fmt: skip
    moved = improved(candidate, figures, site, 0.7)
    factors = [factor for demand in moved.demands.values() for _, factor in demand.headway_profile[:4]]
    assert sum(factors) / len(factors) == pytest.approx(1.0, abs=1e-3)


def test_missing_slow_cells_ask_for_stronger_waves_and_slow_waves_for_larger_gaps(candidate, site):
    figures = {name: replace(entry, share_below_4mps=0.0, wave_mps=0.8 * entry.wave_mps)
               for name, entry in as_measured(site).items()}  # fmt: skip
    moved = improved(candidate, figures, site, 0.5)
    for name in NAMES:
        assert moved.demands[name].exit_wave_amplitude > candidate.demands[name].exit_wave_amplitude
    assert moved.drivers.minimum_gap_m > candidate.drivers.minimum_gap_m
    kept = improved(candidate, figures, site, 0.5, keep_drivers=True)
    assert kept.drivers == candidate.drivers


def test_waves_that_cannot_be_measured_move_nothing_and_count_as_a_miss(candidate, site):
    figures = {name: replace(entry, wave_mps=math.nan) for name, entry in as_measured(site).items()}
    assert improved(candidate, figures, site, 1.0).drivers.minimum_gap_m == candidate.drivers.minimum_gap_m
    assert misfit(figures, site) > 1.0


def test_the_average_of_candidates_has_the_mean_of_each_number_and_keeps_what_is_none(candidate, site):
    figures = {name: replace(entry, share_below_4mps=0.0, density_veh_per_km_lane=50.0,
                             flow_veh_per_h=5 * 3.6 * 50.0 * entry.mean_speed_mps)
               for name, entry in as_measured(site).items()}  # fmt: skip
    other = improved(candidate, figures, site, 0.5)
    average = averaged([candidate, other, other])
    assert averaged([candidate, candidate]) == candidate
    assert average.drivers.headway_s == pytest.approx((candidate.drivers.headway_s + 2 * other.drivers.headway_s) / 3)
    for name in NAMES:
        before, after, mean = (entry.demands[name] for entry in (candidate, other, average))
        assert before.exit_wave_amplitude != after.exit_wave_amplitude
        assert mean.exit_wave_amplitude == pytest.approx(
            (before.exit_wave_amplitude + 2 * after.exit_wave_amplitude) / 3, abs=1e-4
        )
        assert [entry[1] for entry in mean.schedule] == pytest.approx(
            [(first[1] + 2 * second[1]) / 3 for first, second in zip(before.schedule, after.schedule, strict=True)],
            abs=1e-4,
        )
        assert mean.description == before.description
        assert [place for place, _ in mean.headway_profile] == [place for place, _ in before.headway_profile]


MEASURED = VehicleStatistics(lane_changes_per_km=0.8, acceleration_spread_mps2=0.7)


def test_drivers_that_drive_as_measured_stay_as_they_are(candidate):
    drivers = with_bolder_drivers(candidate, MEASURED, MEASURED, 1.0).drivers
    assert drivers.acceleration_scale == pytest.approx(candidate.drivers.acceleration_scale)
    assert drivers.assertiveness == pytest.approx(candidate.drivers.assertiveness)


def test_missing_lane_changes_ask_for_assertive_drivers_and_mild_accelerations_for_stronger_ones(candidate):
    few = with_bolder_drivers(candidate, replace(MEASURED, lane_changes_per_km=0.4), MEASURED, 0.5).drivers
    assert few.assertiveness > candidate.drivers.assertiveness
    assert few.acceleration_scale == candidate.drivers.acceleration_scale
    milder = replace(candidate, drivers=candidate.drivers.model_copy(update={"acceleration_scale": 1.2}))
    strong = with_bolder_drivers(milder, replace(MEASURED, acceleration_spread_mps2=0.5), MEASURED, 0.5).drivers
    assert strong.acceleration_scale > 1.2
    assert strong.assertiveness == pytest.approx(candidate.drivers.assertiveness)


def test_lane_changes_and_accelerations_count_in_the_misfit(site):
    measured = site.model_copy(update={"vehicles": MeasuredVehicles(source="made up", figures=MEASURED)})
    assert misfit(as_measured(site), measured, MEASURED) == 0.0
    assert misfit(as_measured(site), measured, replace(MEASURED, lane_changes_per_km=0.2)) > 0.5


def test_a_calibration_without_assertiveness_leaves_the_vehicle_types_their_own(candidate, tmp_path):
    plain = replace(candidate, drivers=candidate.drivers.model_copy(update={"assertiveness": None}))
    assert "assertiveness" not in as_table(plain)["drivers"]
    write_candidate(tmp_path / "calibration.toml", plain)
    assert file_of(tmp_path / "calibration.toml", CalibrationFile).drivers == plain.drivers
