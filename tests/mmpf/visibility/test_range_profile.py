import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmpf.visibility.range_profile import AS_PROMISED, RINGS, SHARE_BOUNDS, Reach, share_at

NOTHING = Reach.of_data_sheet(100.0)


def test_who_has_seen_nothing_believes_the_data_sheet() -> None:
    np.testing.assert_array_equal(NOTHING.shares(), AS_PROMISED)


def test_the_share_of_each_ring_goes_to_what_is_detected_in_it() -> None:
    rng = np.random.default_rng(0)
    distance = rng.uniform(0.0, 100.0, 40_000)
    found = rng.random(len(distance)) < 0.9 * np.where(distance < 50.0, 1.0, 0.4)
    reach = NOTHING.after(distance, np.full(len(distance), 0.9), found.astype(float), kept=1.0)
    np.testing.assert_allclose(reach.shares(), [1.0] * 5 + [0.4] * 5, atol=0.03)


def test_the_data_sheet_counts_for_as_many_detections_as_it_is_given() -> None:
    reach = NOTHING.after(np.array([5.0]), np.array([20.0]), np.array([10.0]), kept=1.0)
    assert reach.shares()[0] == pytest.approx(30.0 / 40.0)


def test_counts_are_forgotten_and_the_data_sheet_holds_again() -> None:
    none = np.zeros(0)
    reach = NOTHING.after(np.array([5.0]), np.array([1000.0]), np.array([100.0]), kept=1.0)
    assert reach.shares()[0] < 0.15
    assert reach.after(none, none, none, kept=1e-6).shares()[0] == pytest.approx(1.0, abs=1e-3)


def test_beyond_the_range_is_the_last_ring() -> None:
    reach = NOTHING.after(np.array([130.0]), np.array([20.0]), np.array([0.0]), kept=1.0)
    np.testing.assert_allclose(reach.shares(), [1.0] * (RINGS - 1) + [0.5])


def test_between_the_middles_of_two_rings_the_share_is_between_theirs() -> None:
    shares = np.linspace(1.0, 0.1, RINGS)
    found = share_at(np.array([0.0, 5.0, 10.0, 99.0]), shares, 10.0)
    np.testing.assert_allclose(found, [1.0, 1.0, 0.95, 0.1])


@given(st.floats(0.0, 1e4), st.floats(0.0, 1e4))
def test_shares_stay_within_bounds_whatever_is_counted(expected: float, detected: float) -> None:
    reach = NOTHING.after(np.array([42.0]), np.array([expected]), np.array([detected]), kept=0.5)
    shares = reach.shares()
    assert (shares >= SHARE_BOUNDS[0]).all()
    assert (shares <= SHARE_BOUNDS[1]).all()
