"""Tiny frames on a straight road for the tests of the sensor."""

from dataclasses import replace

import numpy as np

from harness.sensor.detector import build_sensor
from harness.sensor.profiles import sensor_settings
from mmpf.map.corridor_road import highway
from tests.harness.closedloop.frames import frame_of as frame_of_cars

ROAD = highway()
MIDDLE = 2.5 * 3.66
CALM = {"clutter_per_scan": 0.0, "detection_probability": 1.0}
# Ten cars in plain view, each of them.
AROUND = [(12.0 * k, side) for k in range(-2, 3) for side in (-7.0, 7.0)]
# So many cars that few scans give many samples: in plain view too, around the ego and not on lanes.
RING = [(40.0 * np.cos(angle), 40.0 * np.sin(angle)) for angle in np.arange(36) * np.pi / 18]
RING_NAMES = [f"car{k}" for k in range(1, 37)]


def frame_of(*cars, ego_lon=300.0, heading=0.0, ego_speed=20.0):
    """Return a frame of the ego in the middle lane and cars given as (metres ahead, metres to the left[, speed])."""
    rows = np.array([(0.0, 0.0, ego_speed)] + [(*car, 20.0)[:3] for car in cars])
    count = len(rows)
    return frame_of_cars(
        ego_lon + rows[:, 0],
        MIDDLE + rows[:, 1],
        rows[:, 2],
        names=["ego"] + [f"car{i}" for i in range(1, count)],
        heading_rad=np.full(count, heading),
        lane=np.full(count, 3),
        length_m=np.full(count, 4.7),
        width_m=np.full(count, 1.9),
    )


def film(frames, profile="lidar-independent", seed=0, **overrides):
    """Return what one sensor makes of frames, scan by scan, a tenth of a second apart."""
    sensor, rng = build_sensor(sensor_settings(profile, overrides)), np.random.default_rng(seed)
    return [sensor.observe(replace(frame, step=k, time_s=0.1 * k), ROAD, rng) for k, frame in enumerate(frames)]


def false_places(seen):
    """Return where an observation's false detections are, along and across the road, m."""
    false = seen.truth_id == ""
    return seen.scan.detections.lon_m[false], seen.scan.detections.lat_m[false]
