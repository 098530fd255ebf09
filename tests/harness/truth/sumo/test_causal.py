"""Frames of the moment: what is exact stays exact, what jumps is filtered by its past alone."""

import numpy as np
import pytest

from harness.truth.sumo.causal import TIME_CONSTANT_S, CausalFilter
from tests.harness.closedloop.frames import frame_of

STEP_S = 0.1


def frames(values, names=None):
    return [
        frame_of(lon=[float(k)], lat=[0.2], step=k, names=names, accel_mps2=[value], lat_speed_mps=[0.5 * value])
        for k, value in enumerate(values)
    ]


def test_it_is_the_plain_recursion_of_a_filter_of_first_order():
    values = np.random.default_rng(3).normal(size=40)
    causal = CausalFilter(STEP_S)
    found = [float(causal.filtered(frame).accel_mps2[0]) for frame in frames(values)]
    keep, state, expected = np.exp(-STEP_S / TIME_CONSTANT_S), values[0], []
    for value in values:
        state = keep * state + (1.0 - keep) * value
        expected.append(state)
    assert found == pytest.approx(expected, abs=1e-4)


def test_what_comes_later_changes_nothing_and_positions_do_not_lag():
    values = np.random.default_rng(4).normal(size=20)
    whole, part = CausalFilter(STEP_S), CausalFilter(STEP_S)
    long = [whole.filtered(frame) for frame in frames(values)]
    short = [part.filtered(frame) for frame in frames(values[:8])]
    assert all((a.accel_mps2 == b.accel_mps2).all() for a, b in zip(long, short, strict=False))
    assert [float(frame.lon_m[0]) for frame in long] == [float(k) for k in range(20)]


def test_a_vehicle_that_comes_anew_begins_with_what_it_has():
    causal = CausalFilter(STEP_S)
    causal.filtered(frames([1.0])[0])
    assert causal.filtered(frames([5.0], names=["other"])[0]).accel_mps2[0] == 5.0
