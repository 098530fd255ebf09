"""The figures of a period, on fields with known answers."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.lab.fidelity.fields import BIN_S, CELL_M, Fields
from harness.lab.fidelity.statistics import period_statistics as statistics_of
from harness.lab.fidelity.statistics import targets, wave_speed

CELLS, BINS = 104, 180
period_statistics = partial(statistics_of, lanes=5)


def waves(speed_mps, period_s=120.0, mean=9.0, swing=4.0, noise=0.0, seed=0, bins=BINS):
    """Return a speed field with waves that travel upstream at a speed."""
    place, time = np.meshgrid(np.arange(CELLS) * CELL_M, np.arange(bins) * BIN_S, indexing="ij")
    field = mean + swing * np.sin(2.0 * np.pi * (time + place / speed_mps) / period_s)
    return field + noise * np.random.default_rng(seed).normal(size=field.shape)


def fields(speed, density=0.2):
    density_field = np.broadcast_to(np.asarray(density, dtype=float), speed.shape)
    return Fields(speed, speed * density_field, density_field)


@settings(max_examples=25, deadline=None)
@given(st.floats(3.5, 9.0), st.floats(100.0, 200.0))
def test_the_speed_of_waves_is_found_to_a_quarter_of_a_bin_between_the_farthest_cells(speed, period):
    longest_lag_s = 195.0 / speed
    found = wave_speed([waves(speed, period)])
    assert found == pytest.approx(speed, rel=0.25 * BIN_S / longest_lag_s)


@pytest.mark.parametrize("speed", [4.0, 5.5, 7.0])
def test_the_speed_of_waves_is_found_in_noise_and_over_several_pieces(speed):
    pieces = [waves(speed, noise=2.0, seed=k, bins=90) for k in range(3)]
    assert wave_speed(pieces) == pytest.approx(speed, rel=0.08)


def test_waves_that_travel_downstream_have_a_negative_speed():
    assert wave_speed([waves(-6.0)]) == pytest.approx(-6.0, rel=0.05)


def test_traffic_without_change_has_no_wave_speed():
    assert np.isnan(wave_speed([np.full((CELLS, BINS), 8.0)]))


def test_a_trend_that_all_cells_share_is_no_wave():
    trend = np.linspace(0.0, 8.0, BINS)
    assert wave_speed([waves(5.0) + trend]) == pytest.approx(5.0, rel=0.08)


def test_mean_speed_is_distance_over_time_and_not_the_mean_of_the_cells():
    speed = np.full((CELLS, 2), 10.0)
    speed[:, 1] = 2.0
    density = np.full((CELLS, 2), 0.1)
    density[:, 1] = 0.3
    figures = period_statistics([fields(speed, density)])
    assert figures.mean_speed_mps == pytest.approx((10.0 * 0.1 + 2.0 * 0.3) / 0.4)
    assert figures.flow_veh_per_h == pytest.approx(3600.0 * 0.8)
    assert figures.density_veh_per_km_lane == pytest.approx(1000.0 * 0.2 / 5)


def test_quarters_are_counted_from_upstream():
    speed = np.repeat(np.array([4.0, 6.0, 8.0, 10.0]), CELLS // 4)[:, None] * np.ones((CELLS, 20))
    figures = period_statistics([fields(speed)])
    assert figures.quarter_speed_mps == pytest.approx((4.0, 6.0, 8.0, 10.0))
    assert figures.quarter_flow_veh_per_h == pytest.approx(tuple(3600.0 * 0.2 * v for v in (4.0, 6.0, 8.0, 10.0)))


def test_slow_cells_are_counted_and_a_cell_at_four_is_not_slow():
    speed = np.full((CELLS, 20), 4.0)
    speed[:, :5] = 3.99
    assert period_statistics([fields(speed)]).share_below_4mps == pytest.approx(0.25)


def test_two_halves_have_the_means_of_the_whole():
    speed = waves(5.5)
    whole = period_statistics([fields(speed)])
    halves = period_statistics([fields(speed[:, :90]), fields(speed[:, 90:])])
    assert halves.mean_speed_mps == pytest.approx(whole.mean_speed_mps)
    assert halves.share_below_4mps == pytest.approx(whole.share_below_4mps)
    assert halves.wave_mps == pytest.approx(whole.wave_mps, rel=0.05)


def test_a_period_meets_all_targets_against_itself():
    figures = period_statistics([fields(waves(5.5))])
    assert all(target.met and target.error == 0.0 for target in targets(figures, figures))


def test_targets_are_missed_by_what_is_beyond_their_tolerance():
    real = period_statistics([fields(waves(5.5))])
    faster = period_statistics([fields(1.06 * waves(5.5))])
    missed = {target.name for target in targets(faster, real) if not target.met}
    assert missed == {"mean speed, m/s", "flow, veh/h"}
    assert all(t.error == pytest.approx(6.0) for t in targets(faster, real) if t.name.startswith("speed in quarter"))


def test_waves_that_cannot_be_seen_miss_their_target():
    real = period_statistics([fields(waves(5.5))])
    still = period_statistics([fields(np.full((CELLS, BINS), 9.0))])
    assert "wave speed, m/s" in {target.name for target in targets(still, real) if not target.met}
