from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmpf.around.detectability import detection_probabilities
from mmpf.scan import SensorModel


def test_detection_probability_falls_with_the_hidden_share_and_ends_at_the_range() -> None:
    probability = detection_probabilities(
        np.array([1.0, 0.7, 0.35, 0.1, 1.0]), np.array([50.0, 50.0, 50.0, 50.0, 120.0]), SensorModel(), 0.02
    )
    assert probability == pytest.approx([0.95, 0.95, 0.475, 0.02, 0.02])


@given(st.floats(0.0, 1.0), st.floats(0.0, 150.0))
def test_a_detection_is_as_probable_as_the_data_sheet_says(visible: float, distance_m: float) -> None:
    sensor = SensorModel(range_m=80.0, detection_probability=0.9, full_view_fraction=0.5, hidden_fraction=0.1)
    found = detection_probabilities(np.array([visible]), np.array([distance_m]), sensor, 0.02)[0]
    unseen = visible < 0.1 or distance_m > 80.0
    assert found == pytest.approx(0.02 if unseen else 0.9 * min(visible / 0.5, 1.0))
