import numpy as np

from harness.scoring.metrics.paired import paired_errors
from tests.harness.scoring.scenes import Scene, score_run


def test_two_trackers_are_compared_only_where_both_follow_the_vehicle():
    steps = np.arange(20)
    vehicle = {"lon": 20.0, "detected": True}
    first = score_run(*Scene(20).vehicle("a", **vehicle).track(7, lon=21.0, at=steps[:15]).tables()).errors
    second = score_run(*Scene(20).vehicle("a", **vehicle).track(9, lon=22.0, at=steps[10:]).tables()).errors
    pairs = paired_errors(first, second)
    assert list(pairs["step"]) == [10, 11, 12, 13, 14]
    assert (pairs["lon_error_m_a"] == 1.0).all()
    assert (pairs["lon_error_m_b"] == 2.0).all()
