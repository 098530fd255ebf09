from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmpf.joint.detectability import detection_probabilities, distances_m, missed_probabilities
from mmpf.scan import SensorModel
from tests.mmpf.scenes import ego_at


def test_detection_probability_falls_with_the_hidden_share_and_ends_at_the_range() -> None:
    probability = detection_probabilities(
        np.array([1.0, 0.7, 0.35, 0.1, 1.0]), np.array([50.0, 50.0, 50.0, 50.0, 120.0]), SensorModel(), 0.02
    )
    assert probability == pytest.approx([0.95, 0.95, 0.475, 0.02, 0.02])


def test_no_detection_weighs_nothing_up_to_one_visible_fraction_and_in_full_from_another_one_on() -> None:
    visible = np.array([0.0, 0.2, 0.35, 0.5, 0.8, 1.0])
    missed = missed_probabilities(visible, np.full(6, 0.95), cap=0.6, begin=0.2, full=0.8)
    assert missed == pytest.approx([0.0, 0.0, 0.15, 0.3, 0.6, 0.6])


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 0.4), st.floats(0.05, 0.6))
def test_no_detection_never_weighs_more_than_the_detection_was_probable(
    visible: float, probability: float, cap: float, begin: float, rise: float
) -> None:
    missed = missed_probabilities(np.array([visible]), np.array([probability]), cap, begin, begin + rise)[0]
    share = min(max((visible - begin) / rise, 0.0), 1.0)
    assert missed == pytest.approx(min(probability, cap * share), abs=1e-9)


@given(st.floats(0.0, 1.0), st.floats(0.0, 150.0))
def test_a_detection_is_as_probable_as_the_data_sheet_says(visible: float, distance_m: float) -> None:
    sensor = SensorModel(range_m=80.0, detection_probability=0.9, full_view_fraction=0.5, hidden_fraction=0.1)
    found = detection_probabilities(np.array([visible]), np.array([distance_m]), sensor, 0.02)[0]
    unseen = visible < 0.1 or distance_m > 80.0
    assert found == pytest.approx(0.02 if unseen else 0.9 * min(visible / 0.5, 1.0))


def test_distances_are_those_from_the_sensor() -> None:
    assert distances_m(ego_at(10.0, 2.0), np.array([13.0, 10.0]), np.array([6.0, 2.0])) == pytest.approx([5.0, 0.0])
