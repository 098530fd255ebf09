"""A scene with a given number of vehicles in range, all in plain view: what a tracker has to do, and nothing else.

Vehicles stand in five lanes at one spacing and drive at one speed; the sensor's range grows with their number. So a
larger scene has more vehicles at the same density, none enters or leaves, and the work per vehicle stays comparable.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from harness.truth.frame import STEP_S
from mmpf.map.road import Road, highway
from mmpf.numerics.arrays import FloatArray
from mmpf.scan import Detections, EgoPose, Scan, SensorModel

LANES = 5
SPACING_M = 22.0
SPEED_MPS = 15.0
STD_LON_M, STD_LAT_M = 0.3, 0.2
JITTER_M = 4.0


@dataclass(frozen=True)
class BenchScene:
    """Road, sensor and scans that all trackers of one row of the table get.

    Attributes:
        road: The lanes.
        sensor: The data sheet.
        scans: The scans.
    """

    road: Road
    sensor: SensorModel
    scans: tuple[Scan, ...]


def bench_scene(vehicles: int, steps: int, rng: np.random.Generator) -> BenchScene:
    """Return a scene of so many vehicles in range beside the ego, and of so many scans."""
    road = highway(LANES)
    lon_m, lat_m, range_m = _places(vehicles, road, rng)
    width_m = LANES * (road.lanes[0].left_m - road.lanes[0].right_m)
    sensor = SensorModel(range_m=range_m, clutter_area_m2=2.0 * range_m * width_m)
    return BenchScene(road, sensor, tuple(_scans(lon_m, lat_m, sensor, width_m, steps, rng)))


def _places(vehicles: int, road: Road, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, float]:
    """Return places relative to an ego in the middle lane, nearest first, and the range that holds them all."""
    rows = vehicles // (2 * LANES) + 2
    along = SPACING_M * np.arange(-rows, rows + 1)
    lane = np.repeat(np.arange(LANES), len(along))
    lon_m = np.tile(along, LANES) + rng.uniform(-0.5 * JITTER_M, 0.5 * JITTER_M, len(lane))
    lat_m = np.array([strip.centre_m for strip in road.lanes])[lane]
    is_ego = (lane == LANES // 2) & (np.tile(along, LANES) == 0.0)
    lon_m, lat_m = lon_m[~is_ego], lat_m[~is_ego]
    distance_m = np.hypot(lon_m, lat_m - road.lanes[LANES // 2].centre_m)
    nearest = np.argsort(distance_m)[:vehicles]
    return lon_m[nearest], lat_m[nearest], float(distance_m[nearest[-1]]) + 5.0


def _scans(
    lon_m: FloatArray, lat_m: FloatArray, sensor: SensorModel, width_m: float, steps: int, rng: np.random.Generator
) -> Iterator[Scan]:
    for step in range(steps):
        time_s = step * STEP_S
        ego = EgoPose(SPEED_MPS * time_s, 0.5 * width_m, 0.0, SPEED_MPS, 4.7, 1.9)
        seen = np.flatnonzero(rng.random(len(lon_m)) < sensor.detection_probability)
        false = int(rng.poisson(sensor.clutter_per_scan))
        lon = np.append(
            lon_m[seen] + rng.normal(0.0, STD_LON_M, len(seen)), rng.uniform(-sensor.range_m, sensor.range_m, false)
        )
        lat = np.append(lat_m[seen] + rng.normal(0.0, STD_LAT_M, len(seen)), rng.uniform(0.0, width_m, false))
        order = rng.permutation(len(lon))
        yield Scan(time_s, _detections(ego.lon_m + lon[order], lat[order]), ego)


def _detections(lon_m: FloatArray, lat_m: FloatArray) -> Detections:
    unmeasured = np.full(len(lon_m), np.nan)
    return Detections(
        lon_m=lon_m,
        lat_m=lat_m,
        speed_mps=unmeasured,
        std_lon_m=np.full(len(lon_m), STD_LON_M),
        std_lat_m=np.full(len(lon_m), STD_LAT_M),
        std_speed_mps=unmeasured,
    )
