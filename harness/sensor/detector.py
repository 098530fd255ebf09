"""The sensor that other vehicles block: what it sees of a frame, and the noisy detections that it makes of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import partial
from typing import cast

import numpy as np
import numpy.typing as npt

from harness.sensor.clutter import ghosts_after, positions_on_road
from harness.sensor.failings import Boxes, advance, detection_probability, merged, miss_chain, shifted, split
from harness.sensor.memory import NORMALS, SensorMemory, VehicleMemory, drifted
from harness.sensor.noise import measured_sizes, measured_speed, position_error, position_std, reported_factors
from harness.sensor.observation import HIDDEN, OUT, PARTIAL, VISIBLE, Observation, Sensor
from harness.sensor.profiles import SensorSettings
from harness.sensor.shadows import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M, free_space, sensor_position, wrap_angle
from harness.sensor.visibility import NO_OCCLUDER, compile_kernels, visible_fractions
from harness.truth.frame import Frame
from mmpf.compute.arrays import BoolArray, FloatArray, IntArray, StringArray, taken
from mmpf.road import Road
from mmpf.scan import BodySizes, Detections, EgoPose, Scan, SensorModel

DECIMALS = 4
CLUTTER_SPEED_MPS = (0.0, 40.0)
SPEED_NORMAL, REPORT_NORMALS = 4, 6


def build_sensor(settings: SensorSettings) -> Sensor:
    """Return the sensor that has these settings, ready to look."""
    compile_kernels()
    return RayedSensor(settings)


@dataclass(frozen=True)
class RayedSensor:
    """A sensor at one point on the ego's roof whose rays end at the first vehicle; the ego itself hides nothing.

    It remembers what fails in runs: one sensor serves one run, whose frames it is shown in order.

    Attributes:
        settings: Its figures.
        memory: What it remembers of the present episode.
    """

    settings: SensorSettings
    memory: SensorMemory = field(default_factory=SensorMemory)

    def model(self) -> SensorModel:
        """Return the data sheet. Clutter is taken to spread over a straight road of the settings' width."""
        return data_sheet(self.settings)

    def observe(self, frame: Frame, road: Road, rng: np.random.Generator) -> Observation:
        """Look at the frame from its ego vehicle.

        Random numbers are drawn in blocks that depend on the number of vehicles alone, then those of clutter that
        flashes up, then those of the shuffle; what lasts has streams of its own below that of ``rng``.

        Vehicles outside the range or the field of view are out: visible fraction 0, no occluder. They still hide
        others as far as they reach into view.
        """
        ego = frame.ego_pose
        step_s = self.memory.begin_scan(rng, frame.episode, frame.time_s)
        sight = _sight_to(frame.lon_m, frame.lat_m, road, ego)
        in_range = _in_reach(self.settings, sight.distance, sight.off_axis)
        in_range[frame.ego] = True
        fraction, occluder = _visibility(frame, road, ego, in_range, self.settings.range_m)
        scene = _Scene(frame, road, sight, fraction, occluder, in_range)
        returns = _vehicle_returns(self.settings, self.memory, scene, step_s, rng)
        flashes = _flashing_returns(self.settings, self.memory, scene, rng)
        standing = _standing_returns(self.settings, self.memory, scene, step_s)
        origin = np.concatenate([returns.origin, flashes.origin, standing.origin])
        order = rng.permutation(len(origin))
        origin = origin[order]
        values = np.concatenate([returns.values, flashes.values, standing.values])[order]
        seen = _Seen(
            _detections(self.settings, values),
            np.where(origin >= 0, frame.vehicle_id[origin], ""),
            np.where(origin >= 0, fraction[origin], np.nan),
        )
        seen = _handed_out(self.settings, self.memory, frame, seen)
        view_rad = np.deg2rad(self.settings.field_of_view_deg)
        return Observation(
            scan=Scan(
                time_s=frame.time_s,
                detections=seen.detections,
                ego=ego,
                free_space=free_space(seen.detections, ego, road, self.settings.range_m, view_rad),
            ),
            truth_id=seen.truth_id,
            detection_visible_fraction=seen.visible_fraction,
            visible_fraction=fraction,
            occluder=occluder,
            in_range=in_range,
            state=_states(self.settings, fraction, in_range),
        )


def data_sheet(settings: SensorSettings) -> SensorModel:
    """Return what a tracker is told of the sensor: its reach as it is, everything else rounded and nominal."""
    return SensorModel(
        range_m=settings.range_m,
        detection_probability=settings.nominal_detection_probability,
        clutter_per_scan=settings.nominal_clutter_per_scan,
        full_view_fraction=settings.nominal_full_view_fraction,
        hidden_fraction=settings.nominal_hidden_fraction,
        clutter_area_m2=2.0 * settings.range_m * settings.road_width_m * settings.field_of_view_deg / 360.0,
        clutter_speed_span_mps=CLUTTER_SPEED_MPS[1] - CLUTTER_SPEED_MPS[0],
        noise_correlated_share=settings.nominal_bias_share,
        noise_correlation_s=settings.nominal_bias_time_s,
    )


@dataclass(frozen=True)
class _Scene:
    """A frame, and how the sensor stands to each of its vehicles: arrays of shape (n,)."""

    frame: Frame
    road: Road
    sight: _Sight
    fraction: FloatArray
    occluder: IntArray
    in_range: BoolArray

    @property
    def ego(self) -> EgoPose:
        return self.frame.ego_pose


@dataclass(frozen=True)
class _Seen:
    """Detections, and the vehicle behind each with its visible fraction, which only scoring may see."""

    detections: Detections
    truth_id: StringArray
    visible_fraction: FloatArray


@dataclass(frozen=True)
class _Sight:
    """Lines of sight: distance, direction, the same against the road at the far end, and off the ego's heading."""

    distance: FloatArray
    bearing: FloatArray
    against_road: FloatArray
    off_axis: FloatArray


@dataclass(frozen=True)
class _Returns:
    """Rows of position, speed, their deviations and four numbers of size, and the vehicle behind each (-1 clutter)."""

    values: FloatArray
    origin: IntArray


def _sight_to(lon_m: FloatArray, lat_m: FloatArray, road: Road, ego: EgoPose) -> _Sight:
    sensor_x, sensor_y = sensor_position(ego, road)
    x, y = road.to_cartesian(lon_m, lat_m)
    bearing = np.arctan2(y - sensor_y, x - sensor_x)
    ego_road = float(road.heading_at(np.array(ego.lon_m)))
    return _Sight(
        distance=np.hypot(x - sensor_x, y - sensor_y),
        bearing=bearing,
        against_road=bearing - road.heading_at(lon_m),
        off_axis=np.abs(wrap_angle(bearing - ego_road - ego.heading_rad)),
    )


def _in_reach(settings: SensorSettings, distance: FloatArray, off_axis: FloatArray) -> BoolArray:
    half_view = np.deg2rad(0.5 * settings.field_of_view_deg)
    return np.asarray(
        (distance <= settings.range_m) & ((off_axis <= half_view) | (settings.field_of_view_deg >= 360.0))
    )


def _visibility(
    frame: Frame, road: Road, ego: EgoPose, in_range: BoolArray, range_m: float
) -> tuple[FloatArray, IntArray]:
    """Return visible fraction and occluder for the whole frame; only vehicles that matter enter the geometry."""
    sensor = sensor_position(ego, road)
    x, y = road.to_cartesian(frame.lon_m, frame.lat_m)
    radius = 0.5 * np.hypot(frame.length_m, frame.width_m)
    may_block = np.hypot(x - sensor[0], y - sensor[1]) <= range_m + radius + radius.max()
    may_block[frame.ego] = False
    chosen = np.flatnonzero(may_block)
    heading = frame.heading_rad + road.heading_at(frame.lon_m)
    part, part_occluder = visible_fractions(
        sensor, x[chosen], y[chosen], heading[chosen], frame.length_m[chosen], frame.width_m[chosen]
    )
    fraction = np.zeros(len(frame))
    occluder = np.full(len(frame), NO_OCCLUDER, dtype=np.int64)
    fraction[chosen] = part
    occluder[chosen] = np.append(chosen, NO_OCCLUDER)[part_occluder]
    fraction[~in_range], occluder[~in_range] = 0.0, NO_OCCLUDER
    fraction[frame.ego] = 1.0
    return fraction, occluder


def _states(settings: SensorSettings, fraction: FloatArray, in_range: BoolArray) -> npt.NDArray[np.int8]:
    conditions = [~in_range, fraction >= settings.full_view_fraction, fraction >= settings.hidden_fraction]
    return np.select(conditions, [OUT, VISIBLE, PARTIAL], default=HIDDEN).astype(np.int8)


def _vehicle_returns(
    settings: SensorSettings, memory: SensorMemory, scene: _Scene, step_s: float, rng: np.random.Generator
) -> _Returns:
    """Return the detections of real vehicles, and remember how they stand."""
    frame, sight, fraction = scene.frame, scene.sight, scene.fraction
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
    origin = np.flatnonzero((chance < probability / (1.0 - misses.share)) & ~gone)
    boxes = _boxes(settings, scene, now, origin)
    normals = np.where(boxes.second[:, None], of_second[boxes.origin], white[boxes.origin])
    drifts = _drifting(settings) * drift[boxes.origin] + _renewed(settings) * normals
    reports = reports[boxes.origin + count * boxes.second]
    named = np.where(boxes.second, -1, boxes.origin)
    return _measured(settings, scene, boxes, named, (drifts, reports))


def _boxes(settings: SensorSettings, scene: _Scene, now: VehicleMemory, origin: IntArray) -> Boxes:
    """Return what the detector takes for vehicles of those that it detects."""
    frame, fraction = scene.frame, scene.fraction
    columns = (frame.lon_m, frame.lat_m, frame.length_m, frame.width_m)
    whole = Boxes(origin, *(column[origin] for column in columns), second=np.zeros(len(origin), dtype=np.bool_))
    boxes = merged(settings, whole, now.merged[origin] > 0.0, fraction[origin])
    # A box that stands for two vehicles is not divided.
    single = boxes.length_m == frame.length_m[boxes.origin]
    boxes = split(settings, boxes, (now.split[boxes.origin] > 0.0) & single, frame.heading_rad[boxes.origin])
    bearing = scene.sight.bearing
    hider = scene.occluder[boxes.origin]
    side = np.sign(wrap_angle(bearing[boxes.origin] - bearing[hider]))
    side[hider < 0] = 0.0
    return shifted(settings, boxes, fraction[boxes.origin], scene.sight.against_road[boxes.origin], side)


def _drifting(settings: SensorSettings) -> FloatArray:
    """Return the deviation of the share that drifts of each of a vehicle's standard normal errors."""
    share = np.full(NORMALS, np.sqrt(settings.bias_share))
    share[SPEED_NORMAL] = 0.0
    return share


def _renewed(settings: SensorSettings) -> FloatArray:
    return np.asarray(np.sqrt(1.0 - _drifting(settings) ** 2))


def _measured(
    settings: SensorSettings, scene: _Scene, boxes: Boxes, named: IntArray, normals: tuple[FloatArray, FloatArray]
) -> _Returns:
    """Return boxes as the sensor measures them, with the numbers of the errors and of what they report."""
    errors, reports = normals
    frame, of = scene.frame, boxes.origin
    fraction = scene.fraction[of]
    distance, angle = scene.sight.distance[of], scene.sight.against_road[of]
    off_lon, off_lat = position_error(position_std(settings, distance, angle, fraction), angle, errors[:, :4])
    speed, _ = measured_speed(settings, angle, frame.speed_mps[of], frame.lat_speed_mps[of], errors[:, SPEED_NORMAL])
    size = measured_sizes(settings, boxes.length_m, boxes.width_m, fraction, errors[:, 5:])
    lon, lat = boxes.lon_m + off_lon, boxes.lat_m + off_lat
    return _reported(settings, scene, (lon, lat, speed, size), (fraction, reports), named)


def _reported(
    settings: SensorSettings,
    scene: _Scene,
    measured: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    report: tuple[FloatArray, FloatArray],
    origin: IntArray,
) -> _Returns:
    """Return measured values with the deviations that they report, which follow from the measured place alone.

    Args:
        settings: The sensor's figures.
        scene: Gives the sensor's pose.
        measured: Longitudinal and lateral position, speed and sizes.
        report: Visible fraction, which shows but a little, and standard normal numbers of the spread.
        origin: Vehicle behind each.
    """
    lon, lat, speed, size = measured
    sight = _sight_to(lon, lat, scene.road, scene.ego)
    plain, zeros = np.ones(len(lon)), np.zeros(len(lon))
    factor = reported_factors(settings, *report)
    nominal = position_std(settings, sight.distance, sight.against_road, plain)
    std_speed = factor[:, 2] * measured_speed(settings, sight.against_road, zeros, zeros, zeros)[1]
    # Near the line of sight beyond which speed is not measured the true and the measured place may disagree.
    speed, std_speed = (np.where(np.isnan(speed + std_speed), np.nan, one) for one in (speed, std_speed))
    if settings.std_length_m is not None and settings.std_width_m is not None:
        size = np.concatenate([size[:, :2], factor[:, 3:] * [settings.std_length_m, settings.std_width_m]], axis=-1)
    place = np.stack([lon, lat, speed, factor[:, 0] * nominal.lon_m, factor[:, 1] * nominal.lat_m, std_speed], axis=-1)
    return _Returns(np.concatenate([place, size], axis=-1), origin)


def _flashing_returns(
    settings: SensorSettings, memory: SensorMemory, scene: _Scene, rng: np.random.Generator
) -> _Returns:
    """Return false detections that flash up once, spread evenly over the lanes in reach, of the size of a car."""
    count = int(rng.poisson(settings.clutter_per_scan))
    lon, lat = positions_on_road(settings, scene.road, scene.ego, count, rng, partial(_place_in_reach, settings, scene))
    sight = _sight_to(lon, lat, scene.road, scene.ego)
    plain_view, zeros = np.ones(len(lon)), np.zeros(len(lon))
    ghost_speed = rng.uniform(*CLUTTER_SPEED_MPS, size=len(lon))
    speed, _ = measured_speed(settings, sight.against_road, ghost_speed, zeros, zeros)
    car = zeros + NOMINAL_LENGTH_M, zeros + NOMINAL_WIDTH_M
    size = measured_sizes(settings, *car, plain_view, rng.standard_normal((len(lon), 2)))
    return _reported_of_nothing(settings, memory, scene, (lon, lat, speed, size))


def _standing_returns(settings: SensorSettings, memory: SensorMemory, scene: _Scene, step_s: float) -> _Returns:
    """Return the detections of false objects that stay, and remember these."""
    rng = memory.streams.ghosts
    memory.ghosts = ghosts = ghosts_after(settings, memory.ghosts, scene.frame, scene.road, step_s, rng)
    chance, normals = rng.random(len(ghosts)), rng.standard_normal((len(ghosts), NORMALS))
    shown = chance < settings.persistent_clutter_probability
    shown &= _place_in_reach(settings, scene, ghosts.lon_m, ghosts.lat_m)
    shown &= scene.road.lane_number_at(ghosts.lon_m, ghosts.lat_m) > 0
    ghosts, normals = taken(ghosts, np.flatnonzero(shown)), normals[shown]
    sight = _sight_to(ghosts.lon_m, ghosts.lat_m, scene.road, scene.ego)
    plain_view, zeros = np.ones(len(ghosts)), np.zeros(len(ghosts))
    std = position_std(settings, sight.distance, sight.against_road, plain_view)
    off_lon, off_lat = position_error(std, sight.against_road, normals[:, :4])
    speed, _ = measured_speed(settings, sight.against_road, ghosts.speed_mps, zeros, normals[:, SPEED_NORMAL])
    size = measured_sizes(settings, ghosts.length_m, ghosts.width_m, plain_view, normals[:, 5:])
    return _reported_of_nothing(settings, memory, scene, (ghosts.lon_m + off_lon, ghosts.lat_m + off_lat, speed, size))


def _reported_of_nothing(
    settings: SensorSettings,
    memory: SensorMemory,
    scene: _Scene,
    measured: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
) -> _Returns:
    """Return false detections with deviations by the law of the true ones, as of vehicles seen to any fraction."""
    count, rng = len(measured[0]), memory.streams.reports
    fraction = rng.choice(_seen_fractions(settings, scene), size=count)
    reports = rng.standard_normal((count, REPORT_NORMALS))
    return _reported(settings, scene, measured, (fraction, reports), np.full(count, -1, dtype=np.int64))


def _seen_fractions(settings: SensorSettings, scene: _Scene) -> FloatArray:
    """Return visible fractions that true detections have just now; one in plain view where there is none."""
    seen = scene.in_range & (scene.fraction >= settings.hidden_fraction)
    seen[scene.frame.ego] = False
    return scene.fraction[seen] if seen.any() else np.ones(1)


def _place_in_reach(settings: SensorSettings, scene: _Scene, lon_m: FloatArray, lat_m: FloatArray) -> BoolArray:
    sight = _sight_to(lon_m, lat_m, scene.road, scene.ego)
    return _in_reach(settings, sight.distance, sight.off_axis)


def _handed_out(settings: SensorSettings, memory: SensorMemory, frame: Frame, seen: _Seen) -> _Seen:
    """Return what is old enough to be handed out now; at first nothing is."""
    if settings.latency_s <= 0.0:
        return seen
    memory.pending.append((frame.time_s, seen))
    due = [k for k, (time_s, _) in enumerate(memory.pending) if time_s <= frame.time_s - settings.latency_s + 1e-6]
    if not due:
        return _Seen(taken(seen.detections, np.zeros(0, dtype=np.int64)), seen.truth_id[:0], seen.visible_fraction[:0])
    late = cast("_Seen", memory.pending[due[-1]][1])
    del memory.pending[: due[-1] + 1]
    # Of a vehicle that has left meanwhile there is no truth.
    still = np.isin(late.truth_id, frame.vehicle_id)
    return _Seen(late.detections, np.where(still, late.truth_id, ""), np.where(still, late.visible_fraction, np.nan))


def _detections(settings: SensorSettings, values: FloatArray) -> Detections:
    rounded = np.round(values, DECIMALS)
    rounded[:, 3:] = np.maximum(rounded[:, 3:], 10.0**-DECIMALS)
    lon, lat, speed, std_lon, std_lat, std_speed, *size = np.ascontiguousarray(rounded.T)
    sizes = BodySizes(*size) if settings.std_length_m and settings.std_width_m else None
    return Detections(lon, lat, speed, std_lon, std_lat, std_speed, sizes)
