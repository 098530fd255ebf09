import hashlib
import subprocess
import sys
from dataclasses import fields, replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stonesoup")

from harness.trackers.catalogue import build_tracker
from harness.trackers.conformance.scripted_scenes import (
    EGO_START_M,
    ROAD,
    SENSOR,
    LabelledScan,
    ScriptedCar,
    scripted_scans,
)
from harness.trackers.protocol import Tracker, TrackerSetting
from harness.trackers.stonesoup.parts import DetectionMaker
from mmpf.tracks import CONFIRMED, HIDDEN, Tracks

NAMES = ["stonesoup-gnn", "stonesoup-jpda", "stonesoup-jpda-stitched"]
CARS = [
    ScriptedCar("ahead", EGO_START_M + 30.0, lane=3, speed_mps=23.0),
    ScriptedCar("left", EGO_START_M + 3.0, lane=2, speed_mps=26.0),
    ScriptedCar("right", EGO_START_M - 9.0, lane=4, speed_mps=17.0),
]


def times(until_s: float) -> list[float]:
    return [0.1 * step for step in range(round(10 * until_s) + 1)]


def build(name: str, seed: int = 0, **options: object) -> Tracker:
    tracker = build_tracker(name, TrackerSetting(ROAD, SENSOR, np.random.default_rng(seed)), options)
    assert hasattr(tracker, "step")
    return tracker


def follow(name: str, scans: list[LabelledScan], seed: int = 0, **options: object) -> list[Tracks]:
    tracker = build(name, seed, **options)
    return [tracker.step(labelled.scan) for labelled in scans]


def with_columns(labelled: LabelledScan, **columns: np.ndarray) -> LabelledScan:
    detections = replace(labelled.scan.detections, **columns)
    return replace(labelled, scan=replace(labelled.scan, detections=detections))


def fingerprint(name: str) -> str:
    scans = scripted_scans(CARS, times(2.0), np.random.default_rng(1), 0.9, 2.0)
    digest = hashlib.sha256()
    for tracks in follow(name, scans):
        for column in fields(Tracks):
            digest.update(getattr(tracks, column.name).tobytes())
    return digest.hexdigest()


@pytest.mark.slow
def test_another_process_with_other_memory_addresses_makes_the_same_bytes():
    program = f"x = [object() for _ in range(12345)]\nfrom {__name__} import *\nprint(*map(fingerprint, NAMES))"
    other = subprocess.run(
        [sys.executable, "-c", program], cwd=Path(__file__).parents[4], capture_output=True, text=True, check=True
    )
    assert other.stdout.split() == [*map(fingerprint, NAMES)]


@pytest.mark.parametrize("name", NAMES)
def test_a_track_without_update_for_half_a_second_is_hidden_and_then_ends(name: str):
    car = ScriptedCar("car", EGO_START_M + 20.0, until_s=2.0)
    scans = scripted_scans([car], times(4.6), np.random.default_rng(3))
    options = {"longest_unseen_s": 2.0, "largest_std_lon_m": 50.0}
    tracks = dict(zip([round(t, 1) for t in times(4.6)], follow(name, scans, **options), strict=True))
    assert tracks[2.4].state.tolist() == [CONFIRMED]
    assert tracks[2.7].state.tolist() == [HIDDEN]
    assert tracks[4.6].state.tolist() == []


def test_noise_that_a_detection_reports_decides_how_much_it_counts():
    car = ScriptedCar("car", EGO_START_M + 20.0)
    precise = scripted_scans([car], times(1.0), np.random.default_rng(4))
    vague = [with_columns(each, std_lon_m=3.0 * each.scan.detections.std_lon_m) for each in precise]
    one, other = (follow("stonesoup-jpda", scans)[-1] for scans in (precise, vague))
    assert other.std_lon_m[0] > 1.5 * one.std_lon_m[0]
    by_option = follow("stonesoup-jpda", precise, noise_factor=3.0)[-1]
    assert by_option.std_lon_m[0] == pytest.approx(other.std_lon_m[0], rel=0.05)


@pytest.mark.parametrize("name", NAMES)
def test_a_measured_speed_is_used(name: str):
    car = ScriptedCar("car", EGO_START_M + 20.0, speed_mps=31.0)
    labelled = scripted_scans([car], times(0.3), np.random.default_rng(5))
    with_speed = [with_columns(each, speed_mps=np.array([31.0]), std_speed_mps=np.array([0.1])) for each in labelled]
    last = follow(name, with_speed)[-1]
    assert last.speed_mps[0] == pytest.approx(31.0, abs=0.5)
    assert last.std_speed_mps[0] < 0.6


@pytest.mark.parametrize("name", NAMES)
def test_cars_at_constant_speed_are_followed(name: str):
    scans = scripted_scans(CARS, times(2.0), np.random.default_rng(6), 0.95, 1.0)
    last = follow(name, scans, lon_noise=1.0)[-1]
    for car in CARS:
        assert np.hypot(last.lon_m - car.lon_at(2.0), last.lat_m - car.lat_m).min() < 1.0


def returning_scene() -> list[LabelledScan]:
    """One car that hides for longer than the tracker coasts, and comes back where it should be."""
    unseen = ScriptedCar("car", EGO_START_M + 20.0, until_s=2.0)
    return scripted_scans([unseen, replace(unseen, until_s=9.0, from_s=5.0)], times(6.0), np.random.default_rng(7))


def test_stitching_gives_a_returning_vehicle_its_identity_back():
    options = {"longest_unseen_s": 2.0}
    plain, stitched = (
        follow(name, returning_scene(), **options) for name in ("stonesoup-jpda", "stonesoup-jpda-stitched")
    )
    assert plain[15].track_id.tolist() != plain[-1].track_id.tolist()
    assert stitched[15].track_id.tolist() == stitched[-1].track_id.tolist()


def test_a_track_remembers_no_more_than_since_its_last_update():
    tracker = build("stonesoup-jpda")
    for labelled in scripted_scans(CARS, times(3.0), np.random.default_rng(8)):
        tracker.step(labelled.scan)
    assert max(len(track.states) for track in tracker._tracker._assembly.tracker.tracks) <= 2


def test_correlated_noise_is_the_covariance_that_stone_soup_measures_with():
    car = ScriptedCar("car", EGO_START_M + 20.0)
    (labelled,) = scripted_scans([car], times(0.1), np.random.default_rng(4))[:1]
    told = replace(labelled.scan.detections, correlation=np.full(len(labelled.scan.detections), 0.42))
    maker = DetectionMaker()
    (found,) = maker.make(told, datetime(2026, 1, 1))
    expected = told.covariance_m2[0] if np.isnan(told.speed_mps[0]) else None
    assert expected is not None
    np.testing.assert_allclose(found.measurement_model.noise_covar, expected, rtol=0.12)
