"""Makes detections from a scene, true and false, each with the vehicle that it came from."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from harness.sensor.failings import (
    DetectedBoxes,
    advance,
    detectabilities,
    detection_probability,
    merged,
    miss_chain,
    shifted,
    split,
)
from harness.sensor.falseobjects import ghosts_after, in_shadow, mirror_images, mirrored_after, posts_along
from harness.sensor.memory import NORMALS, Ghosts, SensorMemory, VehicleMemory, drifted
from harness.sensor.noise import measured_sizes, measured_speed, position_error, position_std, reported_factors
from harness.sensor.scene import Scene, in_reach, sight_to
from harness.storage.schema import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, taken, turned, wrapped

CLUTTER_SPEED_MPS = (0.0, 40.0)
SPEED_NORMAL, REPORT_NORMALS = 4, 6
Measured = tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]
"""Longitudinal and lateral positions, directions of boxes, speeds, each (n,), and sizes."""


@dataclass(frozen=True)
class Returns:
    """Rows of position, speed, their deviations, four numbers of size and the correlation of the position's errors.

    ``origin`` is the vehicle behind each, -1 of clutter.
    """

    values: FloatArray
    origin: IntArray


def vehicle_returns(memory: SensorMemory, scene: Scene, step_s: float, rng: np.random.Generator) -> Returns:
    """Return the detections of real vehicles, and remember how they stand."""
    settings, frame, sight, fraction = scene.settings, scene.frame, scene.sight, scene.fraction
    count = len(frame)
    chance = rng.random(count)
    white = rng.standard_normal((count, NORMALS))
    streams = memory.streams
    of_second = streams.boxes.standard_normal((count, NORMALS))
    reports = streams.reports.standard_normal((2 * count, REPORT_NORMALS))
    reachable = scene.in_range & (np.arange(count) != frame.ego)
    probability = detection_probability(settings, sight.distance, fraction, reachable)
    misses = miss_chain(settings, probability, fraction)
    known = memory.vehicles.of(frame.vehicle_id)
    drift = drifted(known.drift, step_s, settings.bias_time_s, streams.drift.standard_normal((count, NORMALS)))
    now = replace(advance(settings, known, misses, step_s, streams.misses), drift=drift)
    memory.vehicles = now
    gone = (now.missed > 0.0) | (now.burst > 0.0)
    # A vehicle's own factor thins its detections scan by scan; runs of misses stay as they are for all.
    factor = detectabilities(settings, memory, frame)
    origin = np.flatnonzero((chance < factor * (probability / (1.0 - misses.share))) & ~gone)
    boxes = _boxes(scene, now, origin)
    normals = np.where(boxes.second[:, None], of_second[boxes.origin], white[boxes.origin])
    # The deviation of the share that drifts of each of a vehicle's standard normal errors.
    share = np.where(np.arange(NORMALS) == SPEED_NORMAL, 0.0, np.sqrt(settings.bias_share))
    drifts = share * drift[boxes.origin] + np.sqrt(1.0 - share**2) * normals
    reports = reports[boxes.origin + count * boxes.second]
    named = np.where(boxes.second, -1, boxes.origin)
    return _measured(scene, boxes, named, (drifts, reports))


def _boxes(scene: Scene, now: VehicleMemory, origin: IntArray) -> DetectedBoxes:
    """Return what the detector takes for vehicles of those that it detects."""
    settings, frame, fraction = scene.settings, scene.frame, scene.fraction
    lon, lat, length, width = (column[origin] for column in (frame.lon_m, frame.lat_m, frame.length_m, frame.width_m))
    whole = DetectedBoxes(
        origin, lon, lat, length, width, scene.axis_rad[origin], np.zeros(len(origin), dtype=np.bool_)
    )
    boxes = merged(settings, whole, now.merged[origin] > 0.0, fraction[origin])
    # A box that stands for two vehicles is not divided.
    single = boxes.length_m == frame.length_m[boxes.origin]
    boxes = split(settings, boxes, (now.split[boxes.origin] > 0.0) & single, frame.heading_rad[boxes.origin])
    bearing = scene.sight.bearing
    hider = scene.occluder[boxes.origin]
    side = np.sign(wrapped(bearing[boxes.origin] - bearing[hider]))
    side[hider < 0] = 0.0
    return shifted(settings, boxes, fraction[boxes.origin], scene.sight.against_axis[boxes.origin], side)


def _measured(scene: Scene, boxes: DetectedBoxes, named: IntArray, normals: tuple[FloatArray, FloatArray]) -> Returns:
    """Return boxes as the sensor measures them, with the numbers of the errors and of what they report."""
    errors, reports = normals
    settings, frame, of = scene.settings, scene.frame, boxes.origin
    fraction = scene.fraction[of]
    distance, angle = scene.sight.distance[of], scene.sight.against_axis[of]
    off = position_error(position_std(settings, distance, angle, fraction), angle, errors[:, :4])
    off_lon, off_lat = turned(*off, -boxes.axis_rad)
    speed, _ = measured_speed(settings, angle, frame.speed_mps[of], frame.lat_speed_mps[of], errors[:, SPEED_NORMAL])
    size = measured_sizes(settings, boxes.length_m, boxes.width_m, fraction, errors[:, 5:])
    lon, lat = boxes.lon_m + off_lon, boxes.lat_m + off_lat
    return _reported(scene, (lon, lat, boxes.axis_rad, speed, size), (fraction, reports), named)


def _reported(scene: Scene, measured: Measured, report: tuple[FloatArray, FloatArray], origin: IntArray) -> Returns:
    """Return measured values with the deviations that they report, by visible fraction and normal numbers."""
    settings, (lon, lat, axis, speed, size) = scene.settings, measured
    sight = sight_to(lon, lat, scene.road, scene.ego, axis)
    plain, zeros = np.ones(len(lon)), np.zeros(len(lon))
    factor = reported_factors(settings, *report)
    nominal = position_std(settings, sight.distance, sight.against_axis, plain, axis)
    std_speed = factor[:, 2] * measured_speed(settings, sight.against_axis, zeros, zeros, zeros)[1]
    # Near the line of sight beyond which speed is not measured the true and the measured place may disagree.
    speed, std_speed = (np.where(np.isnan(speed + std_speed), np.nan, one) for one in (speed, std_speed))
    if settings.std_length_m is not None and settings.std_width_m is not None:
        size = np.concatenate([size[:, :2], factor[:, 3:] * [settings.std_length_m, settings.std_width_m]], axis=-1)
    place = np.stack([lon, lat, speed, factor[:, 0] * nominal.lon_m, factor[:, 1] * nominal.lat_m, std_speed], axis=-1)
    return Returns(np.concatenate([place, size, nominal.correlation[:, None]], axis=-1), origin)


def flashing_returns(memory: SensorMemory, scene: Scene, rng: np.random.Generator) -> Returns:
    """Return false detections that flash up once, spread evenly over the lanes in reach, of the size of a car."""
    settings = scene.settings
    count = int(rng.poisson(settings.clutter_per_scan))
    near = partial(_place_in_reach, scene)
    lon, lat, axis = scene.road.draw_on_lanes(count, (scene.ego.lon_m, scene.ego.lat_m), settings.range_m, rng, near)
    sight = sight_to(lon, lat, scene.road, scene.ego, axis)
    plain_view, zeros = np.ones(len(lon)), np.zeros(len(lon))
    ghost_speed = rng.uniform(*CLUTTER_SPEED_MPS, size=len(lon))
    speed, _ = measured_speed(settings, sight.against_axis, ghost_speed, zeros, zeros)
    car = zeros + NOMINAL_LENGTH_M, zeros + NOMINAL_WIDTH_M
    size = measured_sizes(settings, *car, plain_view, rng.standard_normal((len(lon), 2)))
    return _reported_of_nothing(memory, scene, (lon, lat, axis, speed, size))


def standing_returns(memory: SensorMemory, scene: Scene, step_s: float) -> Returns:
    """Return the detections of false objects that last, of every kind, and remember these."""
    settings, rng = scene.settings, memory.streams.ghosts
    memory.ghosts = ghosts = ghosts_after(settings, memory.ghosts, scene.frame, scene.road, step_s, rng)
    on_lane = scene.road.on_a_lane(ghosts.lon_m, ghosts.lat_m)
    chance = np.where(on_lane, settings.persistent_clutter_probability, 0.0)
    kinds = [_returns_of(memory, scene, ghosts, chance, rng)]
    if settings.mirrored_clutter > 0.0:
        rng = memory.streams.mirrored
        memory.mirrored = mirrored_after(settings, memory.mirrored, scene, step_s, rng)
        images = mirror_images(memory.mirrored, scene)
        kinds.append(_returns_of(memory, scene, images, settings.mirrored_clutter_probability, rng))
    if settings.posts_per_km > 0.0:
        rng = memory.streams.posts
        if memory.posts is None:
            memory.posts = posts_along(settings, scene.road, scene.ego, rng)
        kinds.append(_returns_of(memory, scene, memory.posts, settings.posts_probability, rng))
    return Returns(np.concatenate([kind.values for kind in kinds]), np.concatenate([kind.origin for kind in kinds]))


def _returns_of(
    memory: SensorMemory, scene: Scene, ghosts: Ghosts, probability: FloatArray | float, rng: np.random.Generator
) -> Returns:
    """Return the detections of false objects, each made with its probability; two blocks of numbers are drawn."""
    settings = scene.settings
    chance, normals = rng.random(len(ghosts)), rng.standard_normal((len(ghosts), NORMALS))
    shown = (chance < probability) & _place_in_reach(scene, ghosts.lon_m, ghosts.lat_m)
    if settings.persistent_clutter_occluded:
        shown &= ~in_shadow(scene, ghosts.lon_m, ghosts.lat_m)
    ghosts, normals = taken(ghosts, shown), normals[shown]
    sight = sight_to(ghosts.lon_m, ghosts.lat_m, scene.road, scene.ego, ghosts.axis_rad)
    plain_view, zeros = np.ones(len(ghosts)), np.zeros(len(ghosts))
    std = position_std(settings, sight.distance, sight.against_axis, plain_view)
    off_lon, off_lat = turned(*position_error(std, sight.against_axis, normals[:, :4]), -ghosts.axis_rad)
    speed, _ = measured_speed(settings, sight.against_axis, ghosts.speed_mps, zeros, normals[:, SPEED_NORMAL])
    size = measured_sizes(settings, ghosts.length_m, ghosts.width_m, plain_view, normals[:, 5:])
    measured = (ghosts.lon_m + off_lon, ghosts.lat_m + off_lat, ghosts.axis_rad, speed, size)
    return _reported_of_nothing(memory, scene, measured)


def _reported_of_nothing(memory: SensorMemory, scene: Scene, measured: Measured) -> Returns:
    """Return false detections with deviations by the law of the true ones, as of vehicles seen to any fraction."""
    count, rng = len(measured[0]), memory.streams.reports
    fraction = rng.choice(_seen_fractions(scene), size=count)
    reports = rng.standard_normal((count, REPORT_NORMALS))
    return _reported(scene, measured, (fraction, reports), np.full(count, -1, dtype=np.int64))


def _seen_fractions(scene: Scene) -> FloatArray:
    """Return visible fractions that true detections have just now; one in plain view where there is none."""
    seen = scene.in_range & (scene.fraction >= scene.settings.hidden_fraction)
    seen[scene.frame.ego] = False
    return scene.fraction[seen] if seen.any() else np.ones(1)


def _place_in_reach(scene: Scene, lon_m: FloatArray, lat_m: FloatArray) -> BoolArray:
    sight = sight_to(lon_m, lat_m, scene.road, scene.ego, 0.0)
    return in_reach(scene.settings, sight.distance, sight.off_axis)
