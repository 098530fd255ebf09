import numpy as np

from harness.trackers.conformance import scripted_scenes
from harness.trackers.oracle import build_oracle_kalman
from harness.trackers.protocol import TrackerSetting
from mmpf.tracks import CONFIRMED, HIDDEN, TENTATIVE, Tracks

TIMES_S = [0.1 * step for step in range(31)]


def follow(scans: list[scripted_scenes.LabelledScan], **options: object) -> list[Tracks]:
    setting = TrackerSetting(scripted_scenes.ROAD, scripted_scenes.SENSOR, np.random.default_rng(0))
    oracle = build_oracle_kalman(setting, options)
    return [oracle.step_associated(labelled.scan, labelled.truth_id) for labelled in scans]


def test_two_cars_that_swap_places_keep_their_identities():
    cars = [
        scripted_scenes.ScriptedCar("fast", scripted_scenes.EGO_START_M - 10.0, lane=2, speed_mps=27.0),
        scripted_scenes.ScriptedCar("slow", scripted_scenes.EGO_START_M + 10.0, lane=2, speed_mps=13.0),
    ]
    tracks = follow(scripted_scenes.scripted_scans(cars, TIMES_S, np.random.default_rng(0)))
    first, last = tracks[5], tracks[-1]
    assert first.track_id[np.argmax(first.speed_mps)] == last.track_id[np.argmax(last.lon_m)]
    assert len(first) == len(last) == 2


def test_clutter_starts_no_track():
    scans = scripted_scenes.scripted_scans([], TIMES_S, np.random.default_rng(1), clutter_per_scan=5.0)
    assert all(len(tracks) == 0 for tracks in follow(scans))


def test_a_track_is_confirmed_at_the_third_detection():
    car = scripted_scenes.ScriptedCar("car", scripted_scenes.EGO_START_M + 20.0)
    states = [
        tracks.state[0]
        for tracks in follow(scripted_scenes.scripted_scans([car], TIMES_S[:4], np.random.default_rng(2)))
    ]
    assert states == [TENTATIVE, TENTATIVE, CONFIRMED, CONFIRMED]


def test_a_track_unseen_for_more_than_half_a_second_is_hidden_and_after_the_limit_it_ends():
    car = scripted_scenes.ScriptedCar("car", scripted_scenes.EGO_START_M + 20.0, until_s=1.0)
    tracks = follow(scripted_scenes.scripted_scans([car], TIMES_S, np.random.default_rng(3)), longest_unseen_s=1.5)
    by_time = dict(zip([round(time_s, 1) for time_s in TIMES_S], tracks, strict=True))
    assert by_time[1.4].state.tolist() == [CONFIRMED]
    assert by_time[1.7].state.tolist() == [HIDDEN]
    assert len(by_time[2.4]) == 1
    assert len(by_time[2.6]) == 0


def test_two_detections_of_one_vehicle_in_one_scan_both_count():
    lon_m, lat_m = scripted_scenes.EGO_START_M + 20.0, 5.0
    once = follow([scripted_scenes.labelled_scan(0.0, [lon_m], [lat_m], ["car"])])[0]
    twice = follow([scripted_scenes.labelled_scan(0.0, [lon_m, lon_m], [lat_m, lat_m], ["car", "car"])])[0]
    assert len(twice) == 1
    np.testing.assert_allclose(twice.std_lon_m, once.std_lon_m / np.sqrt(2.0))


def test_its_errors_are_as_large_as_it_says():
    car = scripted_scenes.ScriptedCar("car", scripted_scenes.EGO_START_M + 20.0, speed_mps=22.0)
    scaled = []
    for seed in range(100):
        scans = scripted_scenes.scripted_scans([car], TIMES_S[:15], np.random.default_rng(seed))
        last = follow(scans, birth_speed_std_mps=2.0)[-1]
        scaled.append((last.lon_m[0] - car.lon_at(TIMES_S[14])) / last.std_lon_m[0])
    # The car holds its speed exactly, so process noise makes the oracle a little too cautious.
    assert 0.6 < np.std(scaled) < 1.1
    assert abs(np.mean(scaled)) < 0.25
