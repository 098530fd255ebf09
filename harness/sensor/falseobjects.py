"""Persistent false objects: on lanes, as mirror images of vehicles, and beside the road; vehicles can hide them."""

from dataclasses import replace

import numpy as np

from harness.config.sensor import SensorSettings
from harness.sensor.memory import Ghosts, Mirrored
from harness.sensor.scene import Scene
from harness.sensor.shadows import sensor_position
from harness.sensor.visibility import first_hits, pack_boxes
from harness.storage.schema import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M
from harness.truth.frame import Frame
from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, joined, taken, turned
from mmpf.scan import EgoPose

GHOST_LENGTH_STD_M, GHOST_WIDTH_STD_M, SMALLEST_GHOST_M = 0.5, 0.15, 0.5
MIRRORED_LEFT_M, MIRRORED_ALONG_STD_M = (3.0, 8.0), 2.0
"""How far beside its vehicle a mirror image is, to either side, and the deviation of how far ahead."""


def ghosts_after(
    settings: SensorSettings,
    before: Ghosts | None,
    frame: Frame,
    road: Road,
    step_s: float,
    rng: np.random.Generator,
) -> Ghosts:
    """Return the false objects a step later: some are gone, some are new, those that move have moved.

    Their number around the ego is Poisson with the asked-for mean at all times and their lives are exponential. One
    that the ego leaves behind comes in again as another at the opposite end of the range, in the plane anywhere on the
    lanes in range, so that driving past them makes them no rarer.

    Args:
        settings: The sensor's figures.
        before: The false objects a step ago; None at the first.
        frame: The traffic, with which some move.
        road: The lanes.
        step_s: Time since the step before.
        rng: Source of randomness.
    """
    ego = frame.ego_pose
    if before is None:
        return _new(settings, int(rng.poisson(settings.persistent_clutter)), frame, road, rng)
    kept = np.exp(-step_s / settings.persistent_clutter_s)
    stays = rng.random(len(before)) < kept
    born = _new(settings, int(rng.poisson(settings.persistent_clutter * (1.0 - kept))), frame, road, rng)
    lon_m, lat_m, axis_rad = road.moved(before.lon_m, before.lat_m, before.axis_rad, before.speed_mps * step_s)
    around = joined(taken(replace(before, lon_m=lon_m, lat_m=lat_m, axis_rad=axis_rad), stays), born)
    lon_m, stays = road.come_round(around.lon_m, around.lat_m, (ego.lon_m, ego.lat_m), settings.range_m)
    others = _new(settings, int((~stays).sum()), frame, road, rng)
    return joined(taken(replace(around, lon_m=lon_m), stays), others)


def _new(settings: SensorSettings, count: int, frame: Frame, road: Road, rng: np.random.Generator) -> Ghosts:
    """Draw false objects evenly over the lanes around the ego, all round whatever the field of view."""
    ego = frame.ego_pose
    place = road.draw_on_lanes(count, (ego.lon_m, ego.lat_m), settings.range_m, rng)
    count = len(place[0])
    moves = rng.random(count) < settings.persistent_clutter_moving
    others = np.flatnonzero(np.arange(len(frame)) != frame.ego)
    like = rng.random(count)
    speed = np.zeros(count)
    if len(others):
        speed = frame.speed_mps[others][(like * len(others)).astype(np.int64)]
    return _of_a_cars_size(place, np.where(moves, speed, 0.0), rng)


def _of_a_cars_size(
    place: tuple[FloatArray, FloatArray, FloatArray], speed_mps: FloatArray, rng: np.random.Generator
) -> Ghosts:
    """Return false objects at longitudinal and lateral positions, along axes, about as large as cars."""
    normals = rng.standard_normal((len(speed_mps), 2))
    length_m = np.maximum(NOMINAL_LENGTH_M + GHOST_LENGTH_STD_M * normals[:, 0], SMALLEST_GHOST_M)
    width_m = np.maximum(NOMINAL_WIDTH_M + GHOST_WIDTH_STD_M * normals[:, 1], SMALLEST_GHOST_M)
    return Ghosts(*place, speed_mps, length_m, width_m)


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
    return joined(taken(before, stays), born)


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
    off_lon, off_lat = turned(mirrored.along_m, mirrored.left_m, -axis)
    return Ghosts(
        lon_m=frame.lon_m[of] + off_lon,
        lat_m=frame.lat_m[of] + off_lat,
        axis_rad=axis,
        speed_mps=frame.speed_mps[of],
        length_m=frame.length_m[of],
        width_m=frame.width_m[of],
    )


def posts_along(settings: SensorSettings, road: Road, ego: EgoPose, rng: np.random.Generator) -> Ghosts:
    """Draw permanent objects beside the road: at the borders of its lanes, or on the lanes in the plane."""
    place = road.draw_beside_lanes(settings.posts_per_km, (ego.lon_m, ego.lat_m), rng)
    return _of_a_cars_size(place, np.zeros(len(place[0])), rng)


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
