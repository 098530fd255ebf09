import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mmpf.scan import SensorModel
from mmpf.visibility.detection_probability import detection_probabilities
from mmpf.visibility.range_profile import AS_PROMISED, RINGS, share_at


def test_detection_probability_falls_with_the_hidden_share_and_ends_at_the_range() -> None:
    probability = detection_probabilities(
        np.array([1.0, 0.7, 0.35, 0.1, 1.0]),
        np.array([50.0, 50.0, 50.0, 50.0, 120.0]),
        SensorModel(),
        AS_PROMISED,
        0.02,
    )
    assert probability == pytest.approx([0.95, 0.95, 0.475, 0.02, 0.02])


@given(st.floats(0.0, 1.0), st.floats(0.0, 150.0))
def test_a_detection_is_as_probable_as_the_data_sheet_says(visible: float, distance_m: float) -> None:
    sensor = SensorModel(range_m=80.0, detection_probability=0.9, full_view_fraction=0.5, hidden_fraction=0.1)
    found = detection_probabilities(np.array([visible]), np.array([distance_m]), sensor, AS_PROMISED, 0.02)[0]
    unseen = visible < 0.1 or distance_m > 80.0
    assert found == pytest.approx(0.02 if unseen else 0.9 * min(visible / 0.5, 1.0))


@given(st.floats(0.0, 99.0), st.integers(0, 2**32 - 1))
def test_what_was_counted_scales_the_data_sheet_between_the_middles_of_the_rings(distance_m: float, seed: int) -> None:
    shares = np.random.default_rng(seed).uniform(0.1, 1.0, RINGS)
    found = detection_probabilities(np.ones(1), np.array([distance_m]), SensorModel(), shares, 0.02)
    assert found == pytest.approx(0.95 * share_at(np.array([distance_m]), shares, SensorModel().range_m / RINGS))


@pytest.mark.parametrize(("promised", "most"), [(0.95, 0.99), (1.0, 1.0)])
def test_however_much_was_detected_only_a_data_sheet_makes_a_sensor_certain(promised: float, most: float) -> None:
    sensor = SensorModel(detection_probability=promised)
    found = detection_probabilities(np.ones(1), np.array([50.0]), sensor, np.full(RINGS, 1.4), 0.02)
    assert found == pytest.approx([most])
