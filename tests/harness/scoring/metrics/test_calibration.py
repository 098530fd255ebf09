from __future__ import annotations

import numpy as np
import pytest

from harness.scoring.metrics.calibration import calibration


def test_a_quantity_without_a_deviation_is_left_out_of_nees_and_coverage():
    result = calibration(np.array([[1.0, 2.0, 50.0]]), np.array([[1.0, 2.0, np.nan]]))
    assert result["nees"] == pytest.approx(1.0)
    assert np.isnan(result["coverage95"]["speed"])


def test_no_estimates_give_no_figures():
    result = calibration(np.zeros((0, 3)), np.zeros((0, 3)))
    assert result["n"] == 0
    assert np.isnan(result["nees"])
