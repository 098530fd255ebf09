import numpy as np
import pytest

from harness.lab.fit.lidar_view import area_under_curve


def test_the_area_is_the_share_of_pairs_that_are_in_order():
    rng = np.random.default_rng(0)
    value, met = rng.integers(0, 5, 40).astype(float), rng.random(40) < 0.6
    pairs = [(a > b) + 0.5 * (a == b) for a in value[met] for b in value[~met]]
    assert area_under_curve(value, met) == pytest.approx(np.mean(pairs))


def test_without_a_vehicle_that_was_missed_there_is_no_area():
    assert np.isnan(area_under_curve(np.arange(3.0), np.ones(3, dtype=np.bool_)))
