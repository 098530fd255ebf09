"""A sensor with hardly any noise: its detections fall between the particles, and must not scatter the cloud."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmpf.joint.evidence import FEWEST_EFFECTIVE, resolvable_std
from mmpf.scan import Scan
from mmpf.tracks import CONFIRMED
from tests.mmpf.scenes import detections_at, ego_at, lane_centre
from tests.mmpf.test_tracker import tracker_with

CARS = [(20.0, lane_centre(1)), (-15.0, lane_centre(3)), (45.0, lane_centre(4))]


def kept(std_m: float) -> tuple[int, float]:
    """Identities that three cars have borne over six seconds, and their largest error from the second one on."""
    tracker, rng = tracker_with(), np.random.default_rng(3)
    names: set[int] = set()
    worst = 0.0
    for step in range(60):
        truth = np.array([(lon + 2.0 * step, lat) for lon, lat in CARS])
        seen = [tuple(place) for place in truth + std_m * rng.standard_normal(truth.shape)]
        tracks = tracker.step(Scan(0.1 * step, detections_at(seen, std_m, std_m), ego_at(lon_m=2.0 * step)))
        confirmed = tracks.state == CONFIRMED
        names |= set(tracks.track_id[confirmed].tolist())
        if step >= 10:
            lon_m, lat_m = tracks.lon_m[confirmed][:, None], tracks.lat_m[confirmed][:, None]
            apart = np.hypot(lon_m - truth[:, 0], lat_m - truth[:, 1])
            worst = max(worst, float(apart.min(axis=0).max()) if confirmed.any() else np.inf)
    return len(names), worst


@pytest.mark.parametrize("std_m", [0.1, 1e-3, 1e-6])
def test_however_exact_the_sensor_each_car_keeps_its_name_and_its_place(std_m: float) -> None:
    names, worst = kept(std_m)
    assert names == len(CARS)
    assert worst < 0.5


@given(st.integers(0, 10_000), st.sampled_from([2, 3]))
@settings(max_examples=100, deadline=None)
def test_no_measurement_leaves_fewer_particles_than_some_and_one_that_leaves_enough_is_untouched(
    seed: int, measured: int
) -> None:
    rng = np.random.default_rng(seed)
    std, spread = np.exp(rng.normal(-2.0, 3.0, (3, 5))), np.exp(rng.normal(0.0, 1.0, (3, 5)))
    std[measured:] = np.nan
    count = rng.integers(100, 2000, 5)

    def left(deviation: np.ndarray) -> np.ndarray:
        share = deviation[:measured] / np.hypot(deviation[:measured], spread[:measured])
        return np.asarray(count * share.prod(axis=0))

    found = resolvable_std(std, spread, count)
    assert left(found) == pytest.approx(np.maximum(left(std), FEWEST_EFFECTIVE))
    enough = left(std) > FEWEST_EFFECTIVE * 1.001
    assert (found[:measured, enough] == std[:measured, enough]).all()
    assert (found[:measured] >= std[:measured]).all()
