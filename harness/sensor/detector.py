"""The sensor that other vehicles block: what it sees of a frame, and the noisy detections that it makes of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from harness.sensor.noise import measured_sizes, measured_speed, position_error, position_std
from harness.sensor.observation import HIDDEN, OUT, PARTIAL, VISIBLE, Observation, Sensor
from harness.sensor.profiles import SensorSettings
from harness.sensor.shadows import NOMINAL_LENGTH_M, NOMINAL_WIDTH_M, free_space, sensor_position, wrap_angle
from harness.sensor.visibility import NO_OCCLUDER, compile_kernels, visible_fractions
from harness.truth.frame import Frame
from mmpf.compute.arrays import BoolArray, FloatArray, IntArray
from mmpf.road import Road
from mmpf.scan import BodySizes, Detections, EgoPose, Scan, SensorModel

DECIMALS = 4
CLUTTER_SPEED_MPS = (0.0, 40.0)


def build_sensor(settings: SensorSettings) -> Sensor:
    """Return the sensor that has these settings, ready to look."""
    compile_kernels()
    return RayedSensor(settings)


@dataclass(frozen=True)
class RayedSensor:
    """A sensor at one point on the ego's roof whose rays end at the first vehicle; the ego itself hides nothing.

    Attributes:
        settings: Its figures.
    """

    settings: SensorSettings

    def model(self) -> SensorModel:
        """Return the data sheet. Clutter is taken to spread over a straight road of the settings' width."""
        settings = self.settings
        return SensorModel(
            range_m=settings.range_m,
            detection_probability=settings.detection_probability,
            clutter_per_scan=settings.clutter_per_scan,
            full_view_fraction=settings.full_view_fraction,
            hidden_fraction=settings.hidden_fraction,
            clutter_area_m2=2.0 * settings.range_m * settings.road_width_m * settings.field_of_view_deg / 360.0,
        )

    def observe(self, frame: Frame, road: Road, rng: np.random.Generator) -> Observation:
        """Look at the frame from its ego vehicle.

        Random numbers are drawn in blocks that depend on the number of vehicles alone, then the clutter's, then those
        of the shuffle.

        Vehicles outside the range or the field of view are out: visible fraction 0, no occluder. They still hide
        others as far as they reach into view.
        """
        ego = frame.ego_pose
        sight = _sight_to(frame.lon_m, frame.lat_m, road, ego)
        in_range = _in_reach(self.settings, sight.distance, sight.off_axis)
        in_range[frame.ego] = True
        fraction, occluder = _visibility(frame, road, ego, in_range, self.settings.range_m)
        returns = _vehicle_returns(self.settings, frame, sight, fraction, in_range, rng)
        false_returns = _clutter_returns(self.settings, road, ego, rng)
        origin = np.concatenate([returns.origin, false_returns.origin])
        order = rng.permutation(len(origin))
        origin = origin[order]
        detections = _detections(self.settings, np.concatenate([returns.values, false_returns.values])[order])
        view_rad = np.deg2rad(self.settings.field_of_view_deg)
        return Observation(
            scan=Scan(
                time_s=frame.time_s,
                detections=detections,
                ego=ego,
                free_space=free_space(detections, ego, road, self.settings.range_m, view_rad),
            ),
            truth_id=np.where(origin >= 0, frame.vehicle_id[origin], ""),
            detection_visible_fraction=np.where(origin >= 0, fraction[origin], np.nan),
            visible_fraction=fraction,
            occluder=occluder,
            in_range=in_range,
            state=_states(self.settings, fraction, in_range),
        )


@dataclass(frozen=True)
class _Sight:
    """Lines of sight: distance, direction against the road at the far end, and off the ego's heading, each (n,)."""

    distance: FloatArray
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
    settings: SensorSettings,
    frame: Frame,
    sight: _Sight,
    fraction: FloatArray,
    in_range: BoolArray,
    rng: np.random.Generator,
) -> _Returns:
    """Return the detections of real vehicles."""
    chance = rng.random(len(frame))
    noise = rng.standard_normal((len(frame), 7))
    probability = settings.detection_probability * np.minimum(1.0, fraction / settings.full_view_fraction)
    probability[~in_range | (fraction < settings.hidden_fraction)] = 0.0
    probability[frame.ego] = 0.0
    origin = np.flatnonzero(chance < probability)
    distance, angle = sight.distance[origin], sight.against_road[origin]
    std = position_std(settings, distance, angle, fraction[origin])
    off_lon, off_lat = position_error(std, angle, noise[origin, :4])
    speed, std_speed = measured_speed(
        settings, angle, frame.speed_mps[origin], frame.lat_speed_mps[origin], noise[origin, 4]
    )
    lon, lat = frame.lon_m[origin] + off_lon, frame.lat_m[origin] + off_lat
    size = measured_sizes(settings, frame.length_m[origin], frame.width_m[origin], fraction[origin], noise[origin, 5:])
    place = np.stack([lon, lat, speed, std.lon_m, std.lat_m, std_speed], axis=-1)
    return _Returns(np.concatenate([place, size], axis=-1), origin)


def _clutter_returns(settings: SensorSettings, road: Road, ego: EgoPose, rng: np.random.Generator) -> _Returns:
    """Return false detections, spread evenly over the lanes in reach; they look like a vehicle in plain view."""
    lon, lat = _positions_on_road(settings, road, ego, int(rng.poisson(settings.clutter_per_scan)), rng)
    sight = _sight_to(lon, lat, road, ego)
    plain_view, zeros = np.ones(len(lon)), np.zeros(len(lon))
    std = position_std(settings, sight.distance, sight.against_road, plain_view)
    ghost_speed = rng.uniform(*CLUTTER_SPEED_MPS, size=len(lon))
    speed, std_speed = measured_speed(settings, sight.against_road, ghost_speed, zeros, zeros)
    car = zeros + NOMINAL_LENGTH_M, zeros + NOMINAL_WIDTH_M
    size = measured_sizes(settings, *car, plain_view, rng.standard_normal((len(lon), 2)))
    place = np.stack([lon, lat, speed, std.lon_m, std.lat_m, std_speed], axis=-1)
    return _Returns(np.concatenate([place, size], axis=-1), np.full(len(lon), -1, dtype=np.int64))


def _positions_on_road(
    settings: SensorSettings, road: Road, ego: EgoPose, count: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draw positions evenly over the lanes in reach, by rejection from the lanes' strips around the ego."""
    _, right, left, start, end = road.lane_table.T
    start = np.maximum(start, ego.lon_m - settings.range_m)
    end = np.minimum(end, ego.lon_m + settings.range_m)
    area = np.maximum(end - start, 0.0) * (left - right)
    kept = np.zeros((0, 2))
    # Where next to no lane is in reach the drawing ends with fewer positions rather than never.
    for _ in range(100):
        if len(kept) >= count or area.sum() <= 0.0:
            break
        lane = rng.choice(len(area), size=max(16, 2 * count), p=area / area.sum())
        lon = rng.uniform(start[lane], np.maximum(start, end)[lane])
        lat = rng.uniform(right[lane], left[lane])
        sight = _sight_to(lon, lat, road, ego)
        inside = _in_reach(settings, sight.distance, sight.off_axis)
        kept = np.concatenate([kept, np.stack([lon, lat], axis=-1)[inside]])
    return kept[:count, 0], kept[:count, 1]


def _detections(settings: SensorSettings, values: FloatArray) -> Detections:
    rounded = np.round(values, DECIMALS)
    rounded[:, 3:] = np.maximum(rounded[:, 3:], 10.0**-DECIMALS)
    lon, lat, speed, std_lon, std_lat, std_speed, *size = np.ascontiguousarray(rounded.T)
    sizes = BodySizes(*size) if settings.std_length_m and settings.std_width_m else None
    return Detections(lon, lat, speed, std_lon, std_lat, std_speed, sizes)
