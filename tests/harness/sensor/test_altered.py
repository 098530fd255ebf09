"""Detections altered after the sensor, in tiny scenes: what is lost, what is added, and that truth stays as it is."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import ValidationError

from harness.config.altered import AlteredSettings
from harness.sensor.altered import altered
from harness.sensor.detector import build_sensor
from harness.sensor.observation import Snapshot
from harness.sensor.profiles import sensor_settings
from tests.harness.sensor.sensor_scenes import AROUND, CALM, RING, ROAD, false_places, frame_of

pytestmark = [pytest.mark.usefixtures("no_shadows"), pytest.mark.slow]
SENSOR = sensor_settings("lidar-independent", {**CALM, "persistent_clutter": 0.0})


def film(steps, cars=AROUND, sensor=SENSOR, looks=20, speed=0.0, car_speed_mps=None):
    """Return snapshots of cars that keep their places to the ego; of one that stands the sensor's looks come again.

    The sensor alone fails in nothing.
    """
    rng, eye = np.random.default_rng(0), build_sensor(sensor)
    frames = [
        replace(frame_of(*cars, ego_lon=300.0 + 0.1 * speed * k), step=k, time_s=round(0.1 * k, 1))
        for k in range(steps)
    ]
    if car_speed_mps is not None:
        frames = [replace(frame, speed_mps=np.full(len(frame), car_speed_mps)) for frame in frames]
    seen = [eye.observe(frame, ROAD, rng) for frame in (frames if speed else frames[:looks])]
    return [Snapshot(frame, seen[k % len(seen)]) for k, frame in enumerate(frames)]


def done(snapshots, seed=0, sensor=SENSOR, **settings):
    return list(altered(snapshots, AlteredSettings(**settings), sensor, ROAD, np.random.SeedSequence(seed)))


def seen(snapshots):
    """Return for each vehicle in which snapshots it was detected."""
    names = sorted({name for snapshot in snapshots for name in snapshot.frame.vehicle_id.tolist()} - {"ego"})
    return {name: np.array([name in snapshot.observation.truth_id for snapshot in snapshots]) for name in names}


def test_the_same_seed_alters_alike_and_another_otherwise():
    snapshots = film(20)
    first, again, other = (done(snapshots, seed, kept_probability=0.5) for seed in (1, 1, 2))

    def names(some):
        return [snapshot.observation.truth_id.tolist() for snapshot in some]

    assert names(first) == names(again)
    assert names(first) != names(other)


def test_detections_are_thinned_and_truth_stays():
    snapshots = film(200)
    thin = done(snapshots, kept_probability=0.75)
    assert np.mean([flags.mean() for flags in seen(thin).values()]) == pytest.approx(0.75, abs=0.03)
    for before, after in zip(snapshots, thin, strict=True):
        assert after.frame is before.frame
        assert after.observation.state is before.observation.state
        kept = np.isin(before.observation.truth_id, after.observation.truth_id)
        assert (before.observation.scan.detections.lon_m[kept] == after.observation.scan.detections.lon_m).all()


@pytest.mark.parametrize("seed", range(5))
def test_one_vehicle_in_five_is_dark_for_the_whole_run(seed):
    shares = {
        name: flags.mean() for name, flags in seen(done(film(200), seed, dark_share=0.2, dark_probability=0.6)).items()
    }
    dark = [share for share in shares.values() if share < 1.0]
    assert len(shares) == 10
    assert len(dark) == 2
    assert dark == pytest.approx([0.6, 0.6], abs=0.12)


def test_bursts_take_their_share_and_have_their_mean_length():
    missed = ~np.array(list(seen(done(film(420, RING), burst_share=0.15, burst_s=0.8)).values()))
    assert missed.mean() == pytest.approx(0.15, abs=0.03)
    begins = (missed[:, 1:] & ~missed[:, :-1]).sum()
    assert 0.1 * missed.sum() / begins == pytest.approx(0.8, rel=0.2)


def test_half_the_detections_are_left_at_the_half_range():
    places = [(20.0, 7.0), (60.0, 1.0), (90.0, 7.0)]
    cars = [(way * ahead, side * aside) for ahead, aside in places for way in (1, -1) for side in (1, -1)]
    flags = seen(done(film(150, cars), half_range_m=60.0))
    for k, place in enumerate(places):
        expected = 1.0 / (1.0 + np.exp((np.hypot(*place) - 60.0) / 8.0))
        found = np.mean([flags[f"car{number}"] for number in range(4 * k + 1, 4 * k + 5)])
        assert found == pytest.approx(expected, abs=0.06)


def test_the_sensor_is_blind_for_the_last_second_of_every_eight():
    counts = [len(snapshot.observation.truth_id) for snapshot in done(film(170), blind_s=1.0, blind_every_s=8.0)]
    assert [k for k, count in enumerate(counts) if count == 0] == [*range(70, 80), *range(150, 160)]


def test_every_second_scan_is_left_with_its_truth_and_its_time():
    half = done(film(10), every_scan=2)
    assert [snapshot.frame.step for snapshot in half] == [0, 1, 2, 3, 4]
    assert [snapshot.frame.time_s for snapshot in half] == [0.0, 0.2, 0.4, 0.6, 0.8]


def test_all_detections_of_a_scan_are_off_with_the_ego_alike():
    snapshots = film(300)
    jittered = done(snapshots, ego_std_m=0.2, ego_std_deg=0.3)
    shifts, turns = [], []
    for before, after in zip(snapshots, jittered, strict=True):
        true, told = before.observation.scan, after.observation.scan
        shift = np.array([told.ego.lon_m - true.ego.lon_m, told.ego.lat_m - true.ego.lat_m])
        turn = told.ego.heading_rad - true.ego.heading_rad
        # By hand: turned about the true ego, then shifted.
        x, y = true.detections.lon_m - true.ego.lon_m, true.detections.lat_m - true.ego.lat_m
        lon = true.ego.lon_m + shift[0] + np.cos(turn) * x - np.sin(turn) * y
        lat = true.ego.lat_m + shift[1] + np.sin(turn) * x + np.cos(turn) * y
        np.testing.assert_allclose([told.detections.lon_m, told.detections.lat_m], [lon, lat], rtol=0.0, atol=1e-4)
        shifts.append(shift)
        turns.append(turn)
        assert after.frame is before.frame
    assert np.std(shifts, axis=0) == pytest.approx([0.2, 0.2], rel=0.15)
    assert np.rad2deg(np.std(turns)) == pytest.approx(0.3, rel=0.15)


def test_false_detections_are_left_out_and_others_put_in():
    noisy = SENSOR.model_copy(update={"clutter_per_scan": 3.0})
    snapshots = film(300, sensor=noisy, looks=100)
    assert np.mean([len(false_places(one.observation)[0]) for one in snapshots]) == pytest.approx(3.0, abs=0.4)
    clean = done(snapshots, sensor=noisy, false_kept=False)
    assert {(len(false_places(one.observation)[0]), len(one.observation.truth_id)) for one in clean} == {(0, 10)}
    others = done(snapshots, sensor=noisy, false_kept=False, clutter_per_scan=1.0)
    counts = [len(false_places(one.observation)[0]) for one in others]
    assert np.mean(counts) == pytest.approx(1.0, abs=0.2)
    for one, count in zip(others, counts, strict=True):
        one.observation.scan.detections.validate()
        assert np.isnan(one.observation.detection_visible_fraction).sum() == count


def test_posts_are_added_where_they_stay():
    snapshots = done(film(100, cars=[(30.0, 0.0)]), posts_per_km=5.0, posts_probability=1.0)
    counts = {len(false_places(snapshot.observation)[0]) for snapshot in snapshots}
    assert len(counts) == 1
    places = [sorted(false_places(snapshot.observation)[0]) for snapshot in snapshots]
    assert np.std(places, axis=0) == pytest.approx(np.full(counts.pop(), 0.3), abs=0.1)


def test_a_blind_time_longer_than_its_period_is_refused():
    with pytest.raises(ValidationError, match="blind_s must be below blind_every_s"):
        AlteredSettings(blind_s=9.0)
