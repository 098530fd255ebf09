"""Smoothing takes jumps away and keeps positions, speeds and accelerations of one piece."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.truth.sumo.corridor_traffic import smoothed
from harness.truth.sumo.smoothing import LEAD_FRAMES, TIME_CONSTANT_S, CausalFilter, hann_weights
from mmpf.map.corridor_road import highway
from tests.harness.closedloop.frames import frame_of

STEP_S = 0.1
FILTERED = ("accel_mps2", "lat_speed_mps")


def driven(accelerations, speed=10.0, ids=("a",), present=None):
    """Return frames of cars side by side that all drive the same accelerations, integrated as SUMO does."""
    lon = 0.0
    for step, accel in enumerate(accelerations):
        faster = speed + accel * STEP_S
        lon += 0.5 * (speed + faster) * STEP_S
        speed = faster
        names = [name for name in ids if present is None or present(name, step)]
        full = np.ones(len(names))
        yield frame_of(lon * full, 1.8 * full, speed * full, step, names, accel_mps2=accel * full)


def smooth(raw):
    """Return the frames in the middle of windows, as a simulation yields them."""
    raw, width = list(raw), 2 * LEAD_FRAMES + 1
    return [smoothed(raw[k : k + width], highway(5), k) for k in range(len(raw) - width + 1)]


def test_steady_motion_passes_unchanged():
    raw = list(driven(np.zeros(20)))
    reach = LEAD_FRAMES
    for k, frame in enumerate(smooth(raw)):
        assert frame.lon_m[0] == pytest.approx(raw[k + reach].lon_m[0], abs=1e-4)
        assert frame.speed_mps[0] == pytest.approx(10.0)
        assert (frame.step, frame.time_s) == (k, pytest.approx(k * STEP_S))


@settings(max_examples=30)
@given(st.lists(st.floats(-8.0, 3.0), min_size=14, max_size=30))
def test_speed_remains_the_integral_of_acceleration_and_position_that_of_speed(accelerations):
    frames = smooth(driven(accelerations, speed=40.0))
    for before, after in itertools.pairwise(frames):
        travelled = 0.5 * (before.speed_mps[0] + after.speed_mps[0]) * STEP_S
        assert after.lon_m[0] - before.lon_m[0] == pytest.approx(travelled, abs=3e-4)
        assert after.speed_mps[0] - before.speed_mps[0] == pytest.approx(after.accel_mps2[0] * STEP_S, abs=3e-4)


def test_braking_for_one_step_becomes_a_gentle_dip():
    accelerations = np.zeros(40)
    accelerations[20] = -8.0
    accel = np.array([frame.accel_mps2[0] for frame in smooth(driven(accelerations))])
    assert accel.min() > -2.0
    assert np.abs(np.diff(accel)).max() < 0.6
    assert accel.sum() == pytest.approx(-8.0, abs=0.01)


def test_a_vehicle_that_was_not_there_all_the_while_is_left_out():
    frames = smooth(driven(np.zeros(30), ids=("a", "late"), present=lambda n, k: n == "a" or k >= 12))
    seen = [set(frame.vehicle_id) for frame in frames]
    assert seen[11] == {"a"}
    assert seen[12] == {"a", "late"}


def test_weights_sum_to_one_and_are_even():
    weights = hann_weights(5)
    assert len(weights) == 11
    assert weights.sum() == pytest.approx(1.0)
    assert np.allclose(weights, weights[::-1])


def frames(values, names=None):
    return [
        frame_of(lon=[float(k)], lat=[0.2], step=k, names=names, accel_mps2=[value], lat_speed_mps=[0.5 * value])
        for k, value in enumerate(values)
    ]


def test_it_is_the_plain_recursion_of_a_filter_of_first_order():
    values = np.random.default_rng(3).normal(size=40)
    causal = CausalFilter(FILTERED)
    found = [float(causal.filtered(frame).accel_mps2[0]) for frame in frames(values)]
    keep, state, expected = np.exp(-STEP_S / TIME_CONSTANT_S), values[0], []
    for value in values:
        state = keep * state + (1.0 - keep) * value
        expected.append(state)
    assert found == pytest.approx(expected, abs=1e-4)


def test_what_comes_later_changes_nothing_and_positions_do_not_lag():
    values = np.random.default_rng(4).normal(size=20)
    whole, part = CausalFilter(FILTERED), CausalFilter(FILTERED)
    long = [whole.filtered(frame) for frame in frames(values)]
    short = [part.filtered(frame) for frame in frames(values[:8])]
    assert all((a.accel_mps2 == b.accel_mps2).all() for a, b in zip(long, short, strict=False))
    assert [float(frame.lon_m[0]) for frame in long] == [float(k) for k in range(20)]


def test_a_vehicle_that_comes_anew_begins_with_what_it_has():
    causal = CausalFilter(FILTERED)
    causal.filtered(frames([1.0])[0])
    assert causal.filtered(frames([5.0], names=["other"])[0]).accel_mps2[0] == 5.0
