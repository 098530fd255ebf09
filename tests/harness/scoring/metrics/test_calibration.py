import numpy as np
import pytest

from harness.scoring.metrics.calibration import calibration_by_visibility, compare_deviations


def calibration(error, std):
    part = compare_deviations(error, std, np.zeros(len(error), dtype=bool))
    return calibration_by_visibility([part], np.random.default_rng(0))


def test_what_has_no_deviation_or_no_estimate_is_left_out_of_nees_and_coverage():
    result = calibration(np.array([[1.0, 2.0, 50.0]]), np.array([[1.0, 2.0, np.nan]]))
    assert result["nees"] == pytest.approx(1.0)
    assert np.isnan(result["coverage95"]["speed"])
    nothing = calibration(np.zeros((0, 3)), np.zeros((0, 3)))
    assert (nothing["n"], np.isnan(nothing["nees"])) == (0, True)
