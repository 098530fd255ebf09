"""False objects that mirror a vehicle, those that stand beside the road for good, and who hides them."""

from __future__ import annotations

import numpy as np

from harness.config.sensor import SensorSettings
from harness.sensor.clutter import GHOST_LENGTH_STD_M, GHOST_WIDTH_STD_M, SMALLEST_GHOST_M
from harness.sensor.memory import Ghosts, Mirrored
from harness.sensor.noise import turned
from harness.sensor.scene import Scene
from harness.sensor.shadows import sensor_position
from harness.sensor.visibility import first_hits, pack_boxes
from harness.storage.schema import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M
from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, joined, taken
from mmpf.scan import EgoPose

MIRRORED_LEFT_M, MIRRORED_ALONG_STD_M = (3.0, 8.0), 2.0
"""How far beside its vehicle a mirror image is, to either side, and the deviation of how far ahead."""


def mirrored_after(
    settings: SensorSettings, before: Mirrored | None, scene: Scene, step_s: float, rng: np.random.Generator
) -> Mirrored:
    """Return the mirror images a step later: some are gone, some are new; none outlives its vehicle's time in range.

    Args:
        settings: The sensor's figures.
        before: The mirror images a step ago; None at the first.
        scene: The vehicles that can be mirrored.
        step_s: Time since the step before.
        rng: Source of randomness.
    """
    if before is None:
        return _new_images(scene, int(rng.poisson(settings.mirrored_clutter)), rng)
    kept = np.exp(-step_s / settings.mirrored_clutter_s)
    stays = rng.random(len(before)) < kept
    stays &= np.isin(before.vehicle_id, scene.frame.vehicle_id[_others_in_range(scene)])
    born = _new_images(scene, int(rng.poisson(settings.mirrored_clutter * (1.0 - kept))), rng)
    return joined(taken(before, np.flatnonzero(stays)), born)


def _others_in_range(scene: Scene) -> IntArray:
    return np.flatnonzero(scene.in_range & (np.arange(len(scene.frame)) != scene.frame.ego))


def _new_images(scene: Scene, count: int, rng: np.random.Generator) -> Mirrored:
    others = _others_in_range(scene)
    which, side, left = rng.random(count), rng.random(count), rng.uniform(*MIRRORED_LEFT_M, size=count)
    along = MIRRORED_ALONG_STD_M * rng.standard_normal(count)
    if not len(others):
        which, side, left, along = which[:0], side[:0], left[:0], along[:0]
        return Mirrored(scene.frame.vehicle_id[:0], along, left)
    mirrored = others[(which * len(others)).astype(np.int64)]
    return Mirrored(scene.frame.vehicle_id[mirrored], along, np.where(side < 0.5, -left, left))


def mirror_images(mirrored: Mirrored, scene: Scene) -> Ghosts:
    """Return where mirror images are: where their vehicles have moved, and as far from them as ever."""
    frame = scene.frame
    row = {name: k for k, name in enumerate(frame.vehicle_id.tolist())}
    of = np.array([row[name] for name in mirrored.vehicle_id.tolist()], dtype=np.int64)
    axis = scene.axis_rad[of]
    off_lon, off_lat = turned(mirrored.along_m, mirrored.left_m, axis)
    return Ghosts(
        lon_m=frame.lon_m[of] + off_lon,
        lat_m=frame.lat_m[of] + off_lat,
        axis_rad=axis,
        speed_mps=frame.speed_mps[of],
        length_m=frame.length_m[of],
        width_m=frame.width_m[of],
    )


def posts_along(settings: SensorSettings, road: Road, ego: EgoPose, rng: np.random.Generator) -> Ghosts:
    """Draw what stands beside the road for good: on the borders of lanes of a road, in the plane on its lanes.

    Args:
        settings: The sensor's figures.
        road: The lanes.
        ego: Where the ego is first; a road without end has posts up to 5 km to either side of it.
        rng: Source of randomness.
    """
    lon, lat, axis = road.draw_beside_lanes(settings.posts_per_km, (ego.lon_m, ego.lat_m), rng)
    count = len(lon)
    normals = rng.standard_normal((count, 2))
    return Ghosts(
        lon_m=lon,
        lat_m=lat,
        axis_rad=axis,
        speed_mps=np.zeros(count),
        length_m=np.maximum(NOMINAL_LENGTH_M + GHOST_LENGTH_STD_M * normals[:, 0], SMALLEST_GHOST_M),
        width_m=np.maximum(NOMINAL_WIDTH_M + GHOST_WIDTH_STD_M * normals[:, 1], SMALLEST_GHOST_M),
    )


def in_shadow(scene: Scene, lon_m: FloatArray, lat_m: FloatArray) -> BoolArray:
    """Return whether a vehicle other than the ego stands between the sensor and each place, shape (k,)."""
    frame, road = scene.frame, scene.road
    sensor = np.array(sensor_position(scene.ego, road))
    others = np.flatnonzero(np.arange(len(frame)) != frame.ego)
    x, y = road.to_cartesian(frame.lon_m[others], frame.lat_m[others])
    heading = road.heading_at(frame.lon_m[others]) + frame.heading_rad[others]
    boxes = pack_boxes(sensor, x, y, heading, frame.length_m[others], frame.width_m[others])
    place_x, place_y = road.to_cartesian(lon_m, lat_m)
    _, _, leaves = first_hits(boxes, np.arctan2(place_y - sensor[1], place_x - sensor[0]))
    return np.asarray(leaves < np.hypot(place_x - sensor[0], place_y - sensor[1]))
