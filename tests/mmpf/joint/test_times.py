"""Times are times: a filter that is given half as many scans a second takes no longer to make up its mind."""

import numpy as np
import pytest

from mmpf.joint.sources import Sources
from mmpf.motion.protocol import motion_models
from mmpf.scan import SensorModel
from mmpf.tracker import MixtureTracker
from mmpf.tracks import CONFIRMED
from tests.mmpf.scenes import ROAD, ego_at, lane_centre, scan_of


@pytest.mark.parametrize("dt_s", [0.05, 0.1, 0.2])
def test_each_hit_counts_for_the_time_since_the_scan_before(dt_s: float) -> None:
    components = Sources.newborn(np.array([1]), np.array([0.9]))
    for was_hit in [True, False, True, True]:
        components = components.after_scan(np.array([was_hit]), dt_s)
    assert components.detected_s == pytest.approx([3.0 * dt_s])
    assert components.hits.tolist() == [4]


def first_confirmed_s(dt_s: float) -> float:
    """When a car that is detected in every scan is reported as a track, among others that are known by then."""
    tracker = MixtureTracker(ROAD, SensorModel(), motion_models["cvm"](), np.random.default_rng(0))
    for step in range(round(10.0 / dt_s)):
        time_s = dt_s * step
        others = [(away + 20.0 * time_s, lane_centre(lane)) for away, lane in ((-20.0, 1), (40.0, 0))]
        new = [(15.0 + 20.0 * time_s, lane_centre(3))] if time_s >= 4.0 - 1e-6 else []
        tracks = tracker.step(scan_of(time_s, [*others, *new], ego_at(lon_m=20.0 * time_s)))
        if (np.abs(tracks.lat_m[tracks.state == CONFIRMED] - lane_centre(3)) < 1.0).any():
            return time_s - 4.0
    return np.inf


@pytest.mark.parametrize("model", ["residual", "cvm"])
def test_the_same_scans_later_give_the_same_tracks(model: str) -> None:
    def tracks_from(begin_s: float) -> list[float]:
        tracker = MixtureTracker(ROAD, SensorModel(), motion_models[model](), np.random.default_rng(0))
        places = [[(20.0 + step, lane_centre(1)), (20.0, lane_centre(3))][: step + 1] for step in range(9)]
        return [tracker.step(scan_of(begin_s + 0.1 * step, place)).lon_m.sum() for step, place in enumerate(places)]

    assert tracks_from(0.0) == tracks_from(86_399.7)


def test_a_new_car_is_reported_as_soon_at_five_scans_a_second_as_at_ten() -> None:
    assert first_confirmed_s(0.2) <= first_confirmed_s(0.1) + 0.2
