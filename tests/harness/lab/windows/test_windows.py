"""Recordings, neighbours and the windows cut from them, on tiny made-up traffic."""

import numpy as np
import pytest

from harness.lab.windows.car_following import following_windows
from harness.lab.windows.changing import changes_to_one_side_per_s, lane_change_windows
from harness.lab.windows.neighbours import NOBODY, clear_gap_m, nearest_row
from harness.lab.windows.recording import (
    Recording,
    cache_of,
    joined_apart,
    load_recording,
    record_traffic,
    recording_of,
    save_recording,
)
from harness.truth.network.network import load_network
from harness.truth.recorded.source import open_recorded_traffic
from mmpf.map.corridor_road import highway
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import taken
from tests.harness.truth.recorded.layouts import Car, ngsim_rows, write_ngsim_csv

STEP_S = 0.1
ROAD = highway(lanes=3, lane_width_m=4.0)


def traffic(*vehicles, steps=301):
    """Each vehicle: start position, speed, and a function of the step that gives its lateral position."""
    rows = []
    for step in range(steps):
        for number, (start, speed, lateral) in enumerate(vehicles):
            lat = lateral(step)
            lane = 3 - int(lat // 4.0)
            rows.append((step, number, lane, start + speed * step * STEP_S, lat, speed, 0.0, 0.0, 5.0))
    columns = np.array(rows).T
    return Recording(*(c.astype(np.int64) for c in columns[:3]), *columns[3:])


def steady(lat):
    return lambda step: lat


def changing(at, start=2.0, end=6.0):
    return lambda step: start + (end - start) * float(np.clip((step - at + 20) / 40.0, 0.0, 1.0))


def brute_force_ahead(recording, row):
    best, nearest = NOBODY, np.inf
    for other in range(len(recording)):
        same = recording.step[other] == recording.step[row] and recording.lane[other] == recording.lane[row]
        distance = recording.lon_m[other] - recording.lon_m[row]
        if same and 0.0 < distance < nearest:
            best, nearest = other, distance
    return best


def test_the_vehicle_ahead_is_the_nearest_in_the_same_lane_at_the_same_step():
    rng = np.random.default_rng(0)
    n = 120
    recording = Recording(
        step=rng.integers(4, size=n),
        vehicle=np.arange(n),
        lane=rng.integers(1, 4, size=n),
        lon_m=rng.uniform(-400.0, 700.0, n),
        lat_m=np.zeros(n),
        speed_mps=np.zeros(n),
        lat_speed_mps=np.zeros(n),
        accel_mps2=np.zeros(n),
        length_m=np.full(n, 5.0),
    )
    at = (recording.step, recording.lane, recording.lon_m)
    ahead, behind = (nearest_row(recording, *at, ahead=side) for side in (True, False))
    np.testing.assert_array_equal(ahead, [brute_force_ahead(recording, row) for row in range(n)])
    led = np.flatnonzero(ahead != NOBODY)
    np.testing.assert_array_equal(behind[ahead[led]], led)


def test_a_gap_is_measured_from_bumper_to_bumper():
    recording = traffic((0.0, 10.0, steady(2.0)), (30.0, 10.0, steady(2.0)), steps=1)
    np.testing.assert_allclose(clear_gap_m(recording, np.array([0, 1]), np.array([1, NOBODY])), [25.0, np.inf])


def test_windows_hold_a_vehicle_and_its_one_leader():
    windows = following_windows(traffic((0.0, 10.0, steady(2.0)), (30.0, 10.0, steady(2.0))), ROAD, 101)
    led = windows.led
    assert len(windows) == 4
    assert len(led) == 2
    np.testing.assert_allclose(led.gap_m, 25.0)
    np.testing.assert_allclose(led.offset_m, 0.0)
    assert not windows.after_cut_in.any()


def test_no_window_lies_within_five_seconds_of_a_lane_change():
    crossing = 200
    windows = following_windows(traffic((0.0, 10.0, changing(crossing)), steps=401), ROAD, 101)
    spans = windows.lon_m[:, [0, -1]] / 10.0 / STEP_S
    assert len(spans) == 2
    assert all(last < crossing - 49 or first > crossing + 49 for first, last in spans)


def test_a_new_nearer_leader_begins_a_window_after_a_cut_in():
    recording = traffic((0.0, 10.0, steady(2.0)), (60.0, 10.0, steady(2.0)), (30.0, 10.0, changing(140, 6.0, 2.0)))
    windows = following_windows(recording, ROAD, 101)
    cut_in = taken(windows, windows.after_cut_in)
    assert len(cut_in) == 1
    np.testing.assert_allclose(cut_in.gap_m, 25.0)


def test_a_leader_further_than_a_hundred_metres_counts_as_none():
    windows = following_windows(traffic((0.0, 10.0, steady(2.0)), (130.0, 10.0, steady(2.0))), ROAD, 101)
    assert not windows.has_leader.any()


def test_vehicles_of_different_recordings_stay_apart_when_joined():
    windows = following_windows(traffic((0.0, 10.0, steady(2.0)), (30.0, 10.0, steady(2.0))), ROAD, 101)
    joined = joined_apart([windows, windows], "vehicle")
    assert len(np.unique(joined.vehicle)) == 4


def test_a_lane_change_is_mirrored_so_that_the_target_lies_to_the_left():
    to_left = lane_change_windows(traffic((0.0, 10.0, changing(150))), ROAD)
    to_right = lane_change_windows(traffic((0.0, 10.0, changing(150, 6.0, 2.0))), ROAD)
    assert len(to_left) == len(to_right) == 1
    assert to_left.state[LAT, 0, 0] == pytest.approx(0.0)
    assert to_left.state[LAT, 0, -1] == pytest.approx(4.0)
    np.testing.assert_allclose(to_left.state[LAT], to_right.state[LAT], atol=0.2)


def test_neighbours_of_a_lane_change_are_those_of_original_and_target_lane():
    recording = traffic(
        (0.0, 10.0, changing(150)), (30.0, 10.0, steady(2.0)), (40.0, 10.0, steady(6.0)), (-20.0, 10.0, steady(6.0))
    )
    change = lane_change_windows(recording, ROAD)
    assert len(change) == 1
    own = change.state[LON, 0]
    np.testing.assert_allclose(change.leader.lon_m[0] - own, 30.0)
    np.testing.assert_allclose(change.target_leader.lon_m[0] - own, 40.0)
    np.testing.assert_allclose(change.follower.lon_m[0] - own, -20.0)


def test_a_recording_is_read_back_as_it_was_written(tmp_path):
    recording = traffic((0.0, 10.0, steady(2.0)), steps=5)
    save_recording(recording, tmp_path / "recording.npz")
    again = load_recording(tmp_path / "recording.npz")
    np.testing.assert_array_equal(again.step, recording.step)
    np.testing.assert_allclose(again.lon_m, recording.lon_m)
    assert [path.name for path in tmp_path.iterdir()] == ["recording.npz"]


def test_an_interrupted_recording_goes_on_where_it_stopped(tmp_path, monkeypatch):
    opened = []

    def open_traffic(network, *, seed, **_):
        opened.append(seed)
        raise KeyboardInterrupt

    monkeypatch.setattr("harness.lab.windows.recording.open_traffic", open_traffic)
    network = load_network("us101")
    (folder := tmp_path / cache_of(network)).mkdir()
    for seed in (1000, 1001):
        save_recording(traffic((0.0, 10.0, steady(2.0)), steps=2), folder / f"density20-seed{seed}-10s.npz")
    with pytest.raises(KeyboardInterrupt):
        record_traffic(network, range(1000, 1003), 10.0, tmp_path, print, [20.0])
    assert opened == [1002]


def test_changes_are_counted_per_second_and_side():
    recording = traffic((0.0, 10.0, changing(150)), (50.0, 10.0, steady(6.0)))
    assert changes_to_one_side_per_s([recording]) == pytest.approx(1.0 / (2 * 60.0))
    assert changes_to_one_side_per_s([]) == 0.0


def test_windows_of_recorded_traffic_have_the_leader_that_drives_ahead(tmp_path):
    cars = (Car(1, 40.0, 9.0, 10.0), Car(2, 70.0, 9.0, 10.0, length_m=6.5), Car(3, 55.0, 5.0, 10.0))
    path = write_ngsim_csv(tmp_path / "scene.csv", ngsim_rows(cars))
    traffic = open_recorded_traffic(path, "ngsim", "us101", "auto", 60.0).traffic
    windows = following_windows(recording_of(traffic), traffic.road, 51)
    led = windows.led
    assert len(windows) == 3
    assert len(led) == 1
    np.testing.assert_allclose(led.gap_m, 30.0 - 0.5 * (4.5 + 6.5), atol=1e-5)
