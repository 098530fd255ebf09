"""What each lane carries beside the others, against sums worked out by hand."""

import numpy as np
import pytest

from harness.lab.fidelity.lanes import lane_shares, ratios
from harness.lab.fidelity.samples import UNITS, BehaviourSamples


def samples(*pieces):
    return BehaviourSamples({name: np.zeros(0) for name in UNITS}, 0, 1.0, np.array(pieces, dtype=float))


EVEN = [[10.0, 100.0]] * 5
FAST_LEFT = [[10.0, 200.0], *[[10.0, 75.0]] * 4]


def test_lanes_that_carry_the_same_have_ratios_of_one():
    assert ratios(np.array([EVEN])) == pytest.approx(np.ones((5, 2)))


def test_a_lane_twice_as_fast_as_the_mean_has_twice_its_speed_and_flow():
    assert ratios(np.array([FAST_LEFT]))[:, 0] == pytest.approx([2.0, 0.75, 0.75, 0.75, 0.75])
    assert ratios(np.array([FAST_LEFT]))[:, 1] == pytest.approx([2.0, 0.75, 0.75, 0.75, 0.75])


def test_the_interval_of_recordings_that_differ_holds_their_pooled_ratio():
    first = lane_shares(samples(EVEN), samples(EVEN, FAST_LEFT))[0]
    assert first.simulated_speed == pytest.approx(1.0)
    assert first.measured_speed == pytest.approx(1.5)
    low, high = first.measured_speed_interval
    assert low == pytest.approx(1.0)
    assert high == pytest.approx(2.0)


def test_a_lane_that_nobody_drove_on_leaves_nothing_to_compare():
    assert lane_shares(samples(EVEN), samples([[0.0, 0.0], *EVEN[1:]])) == ()
