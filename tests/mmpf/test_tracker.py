from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mmpf.motion.protocol import motion_models
from mmpf.options.filter import FilterOptions
from mmpf.scan import InvalidScanError, SensorModel
from mmpf.tracker import MixtureTracker
from mmpf.tracks import CONFIRMED, HIDDEN, TENTATIVE, Tracks
from tests.mmpf.scenes import ROAD, ego_at, lane_centre, scan_of

RULES = ["joint", "max_likelihood"]


def tracker_with(update: str = "joint", particles: int = 300, seed: int = 0) -> MixtureTracker:
    options = FilterOptions.model_validate({"update": update, "particles": particles})
    return MixtureTracker(ROAD, SensorModel(), motion_models["cvm"](), np.random.default_rng(seed), options)


def drive(tracker: MixtureTracker, steps: int, positions: object, first_step: int = 0) -> Tracks:
    """Feed exact detections of cars that keep 20 m/s beside an ego at 20 m/s, seen from the ego."""
    tracks = Tracks.none()
    for step in range(first_step, first_step + steps):
        ego = ego_at(lon_m=2.0 * step)
        seen = positions(step) if callable(positions) else positions
        moved = [(lon + 2.0 * step, lat) for lon, lat in seen]
        tracks = tracker.step(scan_of(0.1 * step, moved, ego))
    return tracks


@pytest.mark.parametrize("update", RULES)
def test_two_cars_in_plain_view_become_two_confirmed_tracks_that_keep_their_names(update: str) -> None:
    tracker = tracker_with(update)
    cars = [(20.0, lane_centre(1)), (-15.0, lane_centre(3))]
    early = drive(tracker, 10, cars)
    late = drive(tracker, 30, cars, first_step=10)
    confirmed = late.state == CONFIRMED
    assert confirmed.sum() == 2
    assert set(late.track_id[confirmed]) <= set(early.track_id)
    assert np.sort(late.lon_m[confirmed]) == pytest.approx([2.0 * 39 - 15.0, 2.0 * 39 + 20.0], abs=0.6)


def test_a_car_behind_another_keeps_its_track_and_name_while_it_is_hidden() -> None:
    tracker = tracker_with()
    front = (15.0, lane_centre(3))

    def seen(step: int) -> list[tuple[float, float]]:
        beside = (15.0, lane_centre(2))
        if step < 20:
            return [(40.0, lane_centre(2)), front]
        return [beside, front] if step < 40 else [beside, (40.0, lane_centre(2)), front]

    before = drive(tracker, 20, seen)
    name = before.track_id[np.argmax(before.lon_m)]
    hidden = drive(tracker, 18, seen, first_step=20)
    assert hidden.state[hidden.track_id == name].tolist() == [HIDDEN]
    after = drive(tracker, 10, seen, first_step=40)
    assert after.state[after.track_id == name].tolist() == [CONFIRMED]


def test_a_car_that_vanishes_in_plain_view_is_soon_doubted_and_dies_in_the_end() -> None:
    tracker = tracker_with()
    drive(tracker, 20, [(20.0, lane_centre(2))])
    # Most of the sensor's runs of misses, of 0.8 s on average, are over by then.
    assert drive(tracker, 25, [], first_step=20).existence[0] < 0.5
    assert len(drive(tracker, 35, [], first_step=45)) == 0


def test_clutter_is_not_confirmed() -> None:
    tracker = tracker_with()
    rng = np.random.default_rng(4)
    for step in range(60):
        ghost = [(rng.uniform(-90.0, 90.0), rng.uniform(0.0, 18.0))]
        tracks = tracker.step(scan_of(0.1 * step, ghost))
        assert (tracks.state == TENTATIVE).all()


@pytest.mark.parametrize("update", RULES)
def test_weights_sum_to_one_within_and_over_components(update: str) -> None:
    tracker = tracker_with(update)
    rng = np.random.default_rng(2)
    for step in range(25):
        cars = [(30.0 + rng.normal(0.0, 0.3), lane_centre(2)), (-20.0, lane_centre(1) + rng.normal(0.0, 0.2))]
        tracker.step(scan_of(0.1 * step, [(lon + 2.0 * step, lat) for lon, lat in cars], ego_at(2.0 * step)))
        mixture = tracker.mixture
        within = np.bincount(mixture.cloud.component, np.exp(mixture.cloud.log_weight))
        assert within == pytest.approx(np.ones(len(mixture)))
        assert np.exp(mixture.cloud.log_component_weight[mixture.starts[:-1]]).sum() == pytest.approx(1.0)


@pytest.mark.slow
@pytest.mark.parametrize("update", RULES)
@given(seed=st.integers(0, 1000), step_s=st.sampled_from([0.1, 1.0]))
@settings(max_examples=15, deadline=None)
def test_nothing_that_a_sensor_may_send_makes_it_fail(update: str, seed: int, step_s: float) -> None:
    tracker = tracker_with(update, particles=50)
    rng = np.random.default_rng(seed)
    for step in range(12):
        count = rng.choice([0, 1, 2, 10, 60])
        positions = list(zip(rng.uniform(-150, 150, count), rng.uniform(-20, 40, count), strict=True))
        if count > 1:
            positions[1] = positions[0]
        tracks = tracker.step(scan_of(step_s * step, positions))
        for name in ("lon_m", "lat_m", "speed_mps", "std_lon_m", "std_lat_m", "std_speed_mps", "existence"):
            assert np.isfinite(getattr(tracks, name)).all(), name
        assert len(set(tracks.track_id)) == len(tracks)


def test_a_refused_scan_leaves_the_filter_as_it_was() -> None:
    tracker = tracker_with()
    before = drive(tracker, 10, [(20.0, lane_centre(2))])
    without_signals = replace(scan_of(1.0, []), open_signals=np.array([True]))
    for bad in (scan_of(0.9 + 1e-6, []), scan_of(1.0, [(np.nan, 1.0)]), scan_of(1.0, [(1.0, np.inf)]), without_signals):
        with pytest.raises(InvalidScanError):
            tracker.step(bad)
    after = drive(tracker, 1, [(20.0, lane_centre(2))], first_step=10)
    assert after.track_id.tolist() == before.track_id.tolist()
