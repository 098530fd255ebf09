"""Smoothing takes jumps away and keeps positions, speeds and accelerations of one piece."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.truth.frame import Frame
from harness.truth.sumo.smoothing import hann_weights, lead_frames, smoothed
from mmpf.map.corridor_road import highway

STEP_S = 0.1


def driven(accelerations, speed=10.0, ids=("a",), present=None):
    """Return frames of cars side by side that all drive the same accelerations, integrated as SUMO does."""
    lon = 0.0
    for step, accel in enumerate(accelerations):
        faster = speed + accel * STEP_S
        lon += 0.5 * (speed + faster) * STEP_S
        speed = faster
        names = [name for name in ids if present is None or present(name, step)]
        full = np.ones(len(names))
        yield Frame(
            step=step,
            time_s=step * STEP_S,
            episode=0,
            ego=-1,
            vehicle_id=np.array(names, dtype=np.str_),
            lon_m=lon * full,
            lat_m=1.8 * full,
            heading_rad=0.0 * full,
            speed_mps=speed * full,
            lat_speed_mps=0.0 * full,
            accel_mps2=accel * full,
            lane=np.full(len(names), 5),
            length_m=4.5 * full,
            width_m=1.8 * full,
        )


def test_steady_motion_passes_unchanged():
    raw = list(driven(np.zeros(20)))
    reach = lead_frames(STEP_S)
    for k, frame in enumerate(smoothed(iter(raw), highway(5), STEP_S)):
        assert frame.lon_m[0] == pytest.approx(raw[k + reach].lon_m[0], abs=1e-4)
        assert frame.speed_mps[0] == pytest.approx(10.0)
        assert (frame.step, frame.time_s) == (k, pytest.approx(k * STEP_S))


@settings(max_examples=30)
@given(st.lists(st.floats(-8.0, 3.0), min_size=14, max_size=30))
def test_speed_remains_the_integral_of_acceleration_and_position_that_of_speed(accelerations):
    frames = list(smoothed(driven(accelerations, speed=40.0), highway(5), STEP_S))
    for before, after in itertools.pairwise(frames):
        travelled = 0.5 * (before.speed_mps[0] + after.speed_mps[0]) * STEP_S
        assert after.lon_m[0] - before.lon_m[0] == pytest.approx(travelled, abs=3e-4)
        assert after.speed_mps[0] - before.speed_mps[0] == pytest.approx(after.accel_mps2[0] * STEP_S, abs=3e-4)


def test_braking_for_one_step_becomes_a_gentle_dip():
    accelerations = np.zeros(40)
    accelerations[20] = -8.0
    accel = np.array([frame.accel_mps2[0] for frame in smoothed(driven(accelerations), highway(5), STEP_S)])
    assert accel.min() > -2.0
    assert np.abs(np.diff(accel)).max() < 0.6
    assert accel.sum() == pytest.approx(-8.0, abs=0.01)


def test_a_vehicle_that_was_not_there_all_the_while_is_left_out():
    frames = smoothed(
        driven(np.zeros(30), ids=("a", "late"), present=lambda n, k: n == "a" or k >= 12), highway(5), 0.1
    )
    seen = [set(frame.vehicle_id) for frame in frames]
    assert seen[11] == {"a"}
    assert seen[12] == {"a", "late"}


def test_weights_sum_to_one_and_are_even():
    weights = hann_weights(5)
    assert len(weights) == 11
    assert weights.sum() == pytest.approx(1.0)
    assert np.allclose(weights, weights[::-1])
