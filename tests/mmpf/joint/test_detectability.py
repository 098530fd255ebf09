from __future__ import annotations

import numpy as np
import pytest

from mmpf.joint.detectability import detection_probabilities
from mmpf.scan import SensorModel


def test_detection_probability_falls_with_the_hidden_share_and_ends_at_the_range() -> None:
    probability = detection_probabilities(
        np.array([1.0, 0.7, 0.35, 0.1, 1.0]), np.array([50.0, 50.0, 50.0, 50.0, 120.0]), SensorModel(), 0.02
    )
    assert probability == pytest.approx([0.95, 0.95, 0.475, 0.02, 0.02])
