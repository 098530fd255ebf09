"""Times are times: a filter that is given half as many scans a second takes no longer to make up its mind."""

import numpy as np
import pytest

from mmpf.joint.sources import Sources
from mmpf.motion.protocol import motion_models
from mmpf.scan import SensorModel
from mmpf.tracker import MixtureTracker
from tests.mmpf.scenes import ROAD, lane_centre, scan_of


@pytest.mark.parametrize("dt_s", [0.05, 0.1, 0.2])
def test_each_hit_counts_for_the_time_since_the_scan_before(dt_s: float) -> None:
    components = Sources.newborn(np.array([1]), np.array([0.9]))
    for was_hit in [True, False, True, True]:
        components = components.after_scan(np.array([was_hit]), dt_s)
    assert components.detected_s == pytest.approx([3.0 * dt_s])
    assert components.hits.tolist() == [4]


@pytest.mark.parametrize("model", ["residual", "cvm"])
def test_the_same_scans_later_give_the_same_tracks(model: str) -> None:
    def tracks_from(begin_s: float) -> list[float]:
        tracker = MixtureTracker(ROAD, SensorModel(), motion_models[model](), np.random.default_rng(0))
        places = [[(20.0 + step, lane_centre(1)), (20.0, lane_centre(3))][: step + 1] for step in range(9)]
        return [tracker.step(scan_of(begin_s + 0.1 * step, place)).lon_m.sum() for step, place in enumerate(places)]

    assert tracks_from(0.0) == tracks_from(86_399.7)
