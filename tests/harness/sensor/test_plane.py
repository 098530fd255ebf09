"""The sensor in the plane: errors along vehicles' own headings, clutter on the lanes wherever they lead."""

import math
from dataclasses import replace

import numpy as np
import pytest

from harness.config.sensor import SensorSettings
from harness.sensor.detector import build_sensor, data_sheet
from harness.sensor.memory import SensorMemory
from harness.sensor.shadows import free_space
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_area import lanes_over, mean_lane_area_m2
from tests.harness.closedloop.frames import frame_of as frame_of_cars
from tests.mmpf.map.scenes import graph_of

pytestmark = pytest.mark.usefixtures("no_shadows")
CROSS = graph_of({"east": [(-150.0, 0.0), (150.0, 0.0)], "north": [(0.0, -150.0), (0.0, 150.0)]}, width_m=4.0)
ROAD = LaneGraphRoad(section_m=(-150.0, 150.0), graph=CROSS)
QUIET = {"clutter_per_scan": 0.0, "reported_spread": 0.0, "detection_probability": 1.0}


def frame_of(*vehicles, step=0):
    """Return an ego at the origin that points east and vehicles, each given by its x, y and heading."""
    x, y, heading_rad = np.array([(0.0, 0.0, 0.0), *vehicles]).T
    every, names = np.ones(len(x)), ["ego", "car", "second"][: len(x)]
    columns = {"length_m": 4.7 * every, "width_m": 1.9 * every, "lane": np.zeros(len(x), dtype=int)}
    return frame_of_cars(x, y, 10.0 * every, step, names, heading_rad=heading_rad, **columns)


def looked(settings, frames, seed=0):
    sensor, rng = build_sensor(settings), np.random.default_rng(seed)
    return [sensor.observe(frame, ROAD, rng).scan.detections for frame in frames]


def covariance(settings, distance_m, bearing, heading):
    """Return the covariance of a box of a vehicle in plain view, from rotation matrices."""

    def turned(along, across, angle):
        turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
        return turn @ np.diag([along**2, across**2]) @ turn.T

    along = math.hypot(settings.std_range_m, settings.std_range_share * distance_m)
    fit = turned(settings.std_lon_m, settings.std_lat_m, heading)
    return fit + turned(along, math.radians(settings.std_bearing_deg) * distance_m, bearing)


@pytest.mark.slow
@pytest.mark.parametrize("heading_deg", [45.0, 160.0])
def test_errors_of_a_turned_vehicle_spread_as_stated(heading_deg):
    settings = SensorSettings(**{**QUIET, "std_bearing_deg": 0.6, "std_lon_m": 0.6})
    heading = math.radians(heading_deg)
    frame = frame_of((30.0, 20.0, heading))
    found = looked(settings, [replace(frame, step=k, time_s=0.1 * k) for k in range(500)])
    errors = np.array([[seen.lon_m[0] - 30.0, seen.lat_m[0] - 20.0] for seen in found if len(seen)])
    expected = covariance(settings, math.hypot(30.0, 20.0), math.atan2(20.0, 30.0), heading)
    assert len(errors) > 470
    assert np.abs(errors.mean(axis=0)).max() < 0.1
    assert np.cov(errors.T) == pytest.approx(expected, rel=0.2, abs=0.02)
    reported = np.mean([[seen.std_lon_m[0], seen.std_lat_m[0]] for seen in found if len(seen)], axis=0)
    assert reported == pytest.approx(np.sqrt(np.diag(expected)), rel=0.02)
    told = np.mean([seen.covariance_m2[0] for seen in found if len(seen)], axis=0)
    assert told == pytest.approx(expected, rel=0.04, abs=0.002)


def test_a_turned_world_is_measured_as_the_same_world():
    """A vehicle ahead that drives along the line of sight, turned with it, has the same errors in its own frame."""
    settings = SensorSettings(**QUIET)
    spread = []
    for angle in (0.0, 2.0):
        place = 40.0 * np.array([math.cos(angle), math.sin(angle)])
        found = looked(settings, [frame_of((*place, angle), step=k) for k in range(150)], seed=4)
        errors = np.array([[seen.lon_m[0], seen.lat_m[0]] for seen in found if len(seen)]) - place
        ahead = np.array([math.cos(angle), math.sin(angle)])
        spread.append(np.stack([errors @ ahead, errors @ [-ahead[1], ahead[0]]]))
    assert spread[0] == pytest.approx(spread[1], abs=2e-4)


def test_range_rate_gives_the_speed_along_the_heading_of_oncoming_vehicles_too():
    settings = SensorSettings(**{**QUIET, "std_range_rate_mps": 0.2})
    for heading in (0.0, math.pi):
        found = looked(settings, [frame_of((50.0, 0.0, heading), step=k) for k in range(100)])
        speeds = [seen.speed_mps[0] for seen in found if len(seen)]
        assert np.mean(speeds) == pytest.approx(10.0, abs=0.1)


@pytest.mark.slow
def test_a_hidden_half_pulls_the_box_towards_the_near_end_whatever_its_heading():
    settings = SensorSettings(**{**QUIET, "centre_shift_share": 1.0})
    for angle in (0.0, 1.0, 3.0):
        ahead = np.array([math.cos(angle), math.sin(angle)])
        hidden, hider = (*(30.0 * ahead), angle), (*(12.0 * ahead + np.array([-ahead[1], ahead[0]])), angle)
        sensor, rng = build_sensor(settings), np.random.default_rng(1)
        away = []
        for k in range(150):
            seen = sensor.observe(frame_of(hidden, hider, step=k), ROAD, rng)
            row = np.flatnonzero(seen.truth_id == "car")
            detections = seen.scan.detections
            away += [np.array([detections.lon_m[k], detections.lat_m[k]]) @ ahead - 30.0 for k in row]
        assert -1.6 < np.mean(away) < -0.3


def test_clutter_is_even_over_the_lanes_and_counts_a_crossing_once():
    settings = SensorSettings(**{"clutter_per_scan": 40.0, "detection_probability": 0.0})
    found = looked(settings, [frame_of((60.0, 3.0, 0.0), step=k) for k in range(200)])
    x, y = (np.concatenate([getattr(seen, name) for seen in found]) for name in ("lon_m", "lat_m"))
    assert len(x) == pytest.approx(8000, rel=0.05)
    east, north = np.abs(y) <= 2.0, np.abs(x) <= 2.0
    assert (east | north).mean() > 0.999
    # Of 2 x 200 m x 4 m the crossing, 4 m x 4 m, belongs to both.
    assert (east & north).mean() == pytest.approx(16.0 / (1600.0 - 16.0), abs=0.004)
    assert east.mean() == pytest.approx(0.5 * (1.0 + 16.0 / 1584.0), abs=0.02)


def test_lasting_false_objects_that_move_go_along_the_lanes():
    overrides = {"persistent_clutter": 5.0, "persistent_clutter_moving": 1.0, "persistent_clutter_s": 50.0}
    settings = SensorSettings(**{**QUIET, **overrides})
    sensor = build_sensor(settings)
    rng = np.random.default_rng(3)
    assert isinstance(sensor.memory, SensorMemory)
    moved = []
    before = None
    for k in range(60):
        sensor.observe(frame_of((60.0, 3.0, 0.0), step=k), ROAD, rng)
        ghosts = sensor.memory.ghosts
        assert (lanes_over(CROSS, ghosts.lon_m, ghosts.lat_m) > 0).all()
        if before is not None and len(before) == len(ghosts):
            step = np.stack([ghosts.lon_m - before.lon_m, ghosts.lat_m - before.lat_m])
            ahead = np.stack([np.cos(ghosts.axis_rad), np.sin(ghosts.axis_rad)])
            same = np.hypot(*step) < 5.0
            moved += list((step - 0.1 * ghosts.speed_mps * ahead)[:, same].ravel())
        before = ghosts
    assert len(moved) > 100
    assert np.abs(moved).max() < 1e-6


def test_the_data_sheet_tells_how_much_of_the_maps_lanes_is_in_range():
    # Every place of one long lane has 2 x 50 m of it in range, but for those near its ends.
    lane = graph_of({"a": [(0.0, 0.0), (2000.0, 0.0)]}, width_m=3.0)
    assert mean_lane_area_m2(lane, 50.0) == pytest.approx(3.0 * (100.0 - 50.0**2 / 2000.0), rel=0.01)
    settings = SensorSettings()
    sheet = data_sheet(settings, LaneGraphRoad(graph=lane))
    assert sheet.clutter_area_m2 == pytest.approx(mean_lane_area_m2(lane, settings.range_m))
    assert data_sheet(settings).clutter_area_m2 == pytest.approx(2.0 * 100.0 * 18.3)


def test_detected_vehicles_cast_shadows_along_the_lanes_that_they_are_on(monkeypatch):
    monkeypatch.setattr("harness.sensor.detector.free_space", free_space)
    settings = SensorSettings(**{**QUIET, "std_lon_m": 1e-3, "std_lat_m": 1e-3, "std_bearing_deg": 0.0})
    sensor = build_sensor(settings)
    seen = sensor.observe(frame_of((0.0, 30.0, 0.5 * math.pi)), ROAD, np.random.default_rng(0))
    north = int((0.5 * math.pi + math.pi) / (2.0 * math.pi / 720))
    # Half a length of about 4.7 m, and not half a width, lies behind its middle.
    assert seen.scan.free_space.range_m[north] == pytest.approx(32.35, abs=1.0)
    shadowed = seen.scan.free_space.range_m < 99.0
    assert shadowed.sum() * 0.5 == pytest.approx(math.degrees(1.9 / 27.65), abs=1.2)


def test_a_person_on_foot_hides_who_is_behind_and_is_itself_no_detection():
    """A body half a metre wide, ten metres away, covers 1.0 m of what is twenty metres away."""
    car = (20.0, 0.0, 0.5 * math.pi)
    size = {"length_m": np.array([4.7, 4.7, 0.2]), "width_m": np.array([1.9, 1.9, 0.5])}
    walked = replace(frame_of(car, (10.0, 0.0, 0.0)), **size, pedestrian=np.array([False, False, True]))
    sensor, rng = build_sensor(SensorSettings(**QUIET)), np.random.default_rng(0)
    alone = sensor.observe(frame_of(car), ROAD, rng)
    seen = sensor.observe(walked, ROAD, rng)
    assert alone.visible_fraction[1] == 1.0
    # The sensor is on the roof, so that the person's shadow lies on the side of the car that faces it.
    assert seen.visible_fraction[1] == pytest.approx(1.0 - 0.5 / 9.9 * (20.0 - 0.95) / 4.7, abs=0.02)
    assert seen.occluder[1] == 2
    assert not seen.in_range[2]
    assert set(seen.truth_id) == {"car"}
