"""The simulated sensor: geometric visibility, then noisy detections."""

from dataclasses import dataclass, field, replace
from typing import cast

import numpy as np
import numpy.typing as npt
from scipy.special import expit

from harness.config.sensor import SensorSettings
from harness.sensor.memory import SensorMemory
from harness.sensor.observation import Observation, Sensor
from harness.sensor.returns import CLUTTER_SPEED_MPS, flashing_returns, standing_returns, vehicle_returns
from harness.sensor.scene import Scene, in_reach, sight_to
from harness.sensor.shadows import free_space, sensor_position
from harness.sensor.visibility import NO_OCCLUDER, compile_kernels, visible_fractions
from harness.storage.schema import HIDDEN, OUT, PARTIAL, VISIBLE
from harness.truth.frame import Frame
from mmpf.map.corridor_road import highway
from mmpf.map.road import Road, wall_bodies
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, StringArray, taken
from mmpf.scan import (
    CAR,
    UNKNOWN_CLASS,
    VEHICLE_CLASSES,
    BodySizes,
    Detections,
    EgoPose,
    FreeSpace,
    Scan,
    SensorModel,
)

DECIMALS = 4
MOST_CORRELATED = 0.999
LEAST_SCORE = 0.001
ROAD_WIDTH_M = 18.3
"""Road width over which trackers assume uniform clutter."""


def build_sensor(settings: SensorSettings) -> Sensor:
    """Return the sensor that has these settings, ready to look."""
    compile_kernels()
    return RayedSensor(settings)


@dataclass(frozen=True)
class RayedSensor:
    """A sensor at one point on the ego's roof whose rays end at the first vehicle; the ego itself hides nothing.

    It remembers what fails in runs: one sensor serves one run, whose frames it is shown in order.
    """

    settings: SensorSettings
    memory: SensorMemory = field(default_factory=SensorMemory)

    def model(self, road: Road | None = None) -> SensorModel:
        """Return the data sheet; see ``data_sheet``."""
        return data_sheet(self.settings, road)

    def observe(self, frame: Frame, road: Road, rng: np.random.Generator) -> Observation:
        """Look at the frame from its ego vehicle.

        Random numbers are drawn in blocks that depend on the number of vehicles alone, then those of clutter that
        flashes up, then those of the shuffle; what lasts has streams of its own below that of ``rng``.

        Vehicles outside the range or the field of view are out: visible fraction 0, no occluder. They still hide
        others as far as they reach into view.
        """
        ego = frame.ego_pose
        step_s = self.memory.begin_scan(rng, frame.episode, frame.time_s)
        scene, behind_walls = view_of(self.settings, frame, road)
        fraction, occluder, in_range = scene.fraction, scene.occluder, scene.in_range
        returns = vehicle_returns(self.memory, scene, step_s, rng)
        flashes = flashing_returns(self.memory, scene, rng)
        standing = standing_returns(self.memory, scene, step_s)
        origin = np.concatenate([returns.origin, flashes.origin, standing.origin])
        order = rng.permutation(len(origin))
        origin = origin[order]
        values = np.concatenate([returns.values, flashes.values, standing.values])[order]
        found = _scored(self.settings, detections_from(self.settings, values, road), origin >= 0, self.memory)
        seen = _Seen(
            _classified(self.settings, found, origin, frame, self.memory),
            np.where(origin >= 0, frame.vehicle_id[origin], ""),
            np.where(origin >= 0, fraction[origin], np.nan),
        )
        seen = _handed_out(self.settings, self.memory, frame, seen)
        return Observation(
            scan=Scan(frame.time_s, seen.detections, ego, own_shadows(self.settings, seen.detections, ego, road)),
            truth_id=seen.truth_id,
            detection_visible_fraction=seen.visible_fraction,
            visible_fraction=fraction,
            occluder=occluder,
            behind_walls=behind_walls,
            in_range=in_range,
            state=states_of(self.settings, fraction, in_range),
        )


def data_sheet(settings: SensorSettings, road: Road | None = None) -> SensorModel:
    """Return the data sheet for trackers: the range is exact, everything else is rounded and nominal.

    Clutter is taken to spread over a straight road of ``ROAD_WIDTH_M``. Where the road frame is the plane, it is
    taken to spread over as much of the map's lanes as lies in range on the average over the map, which a tracker that
    has the map could work out; without a map, over all that is in range.

    Args:
        settings: The sensor's figures.
        road: Where it will be used; None for a straight road.
    """
    area_m2 = (road or highway()).lane_area_m2(settings.range_m, ROAD_WIDTH_M)
    return SensorModel(
        range_m=settings.range_m,
        detection_probability=settings.nominal_detection_probability,
        clutter_per_scan=settings.nominal_clutter_per_scan,
        full_view_fraction=settings.nominal_full_view_fraction,
        hidden_fraction=settings.nominal_hidden_fraction,
        clutter_area_m2=area_m2 * settings.field_of_view_deg / 360.0,
        clutter_speed_span_mps=CLUTTER_SPEED_MPS[1] - CLUTTER_SPEED_MPS[0],
        noise_correlated_share=settings.nominal_bias_share,
        noise_correlation_s=settings.nominal_bias_time_s,
        class_accuracy=settings.class_accuracy,
    )


@dataclass(frozen=True)
class _Seen:
    """Detections, and the vehicle behind each with its visible fraction, which only scoring may see."""

    detections: Detections
    truth_id: StringArray
    visible_fraction: FloatArray


def view_of(settings: SensorSettings, frame: Frame, road: Road) -> tuple[Scene, FloatArray | None]:
    """Return the geometry between sensor and frame, what is visible, and the share of each vehicle behind walls."""
    ego = frame.ego_pose
    sight = sight_to(frame.lon_m, frame.lat_m, road, ego, road.axis_of(frame.heading_rad))
    in_range = in_reach(settings, sight.distance, sight.off_axis)
    if frame.pedestrian is not None:
        # They hide others like any body, and are no vehicles that a detector of vehicles could report.
        in_range &= ~frame.pedestrian
    in_range[frame.ego] = True
    fraction, occluder, behind_walls = visibility_of(frame, road, ego, in_range, settings.range_m)
    return Scene(settings, frame, road, sight, fraction, occluder, in_range), behind_walls


def visibility_of(
    frame: Frame, road: Road, ego: EgoPose, in_range: BoolArray, range_m: float
) -> tuple[FloatArray, IntArray, FloatArray | None]:
    """Return what is seen of each vehicle of the frame; only vehicles that matter enter the geometry.

    Args:
        frame: The truth.
        road: The road.
        ego: Pose of the sensor's vehicle.
        in_range: What is in reach of the sensor; of the rest nothing is seen, shape (n,).
        range_m: The sensor's range.

    Returns:
        The visible fractions; the index of the vehicle that covers most of each, -1 where none does; and the share
        behind walls, None on a road without walls; each of shape (n,).
    """
    sensor = sensor_position(ego, road)
    x, y = road.to_cartesian(frame.lon_m, frame.lat_m)
    radius = 0.5 * np.hypot(frame.length_m, frame.width_m)
    may_block = np.hypot(x - sensor[0], y - sensor[1]) <= range_m + radius + radius.max()
    may_block[frame.ego] = False
    chosen = np.flatnonzero(may_block)
    heading = frame.heading_rad + road.heading_at(frame.lon_m)
    bodies = np.stack([x, y, heading, frame.length_m, frame.width_m])[:, chosen]
    walls = wall_bodies(road.walls_near(*sensor, range_m))
    part, part_occluder, part_behind = visible_fractions(sensor, bodies, walls)
    # What a wall hides no vehicle hides.
    part_occluder[part_occluder >= len(chosen)] = NO_OCCLUDER
    fraction, behind_walls = np.zeros(len(frame)), np.zeros(len(frame))
    occluder = np.full(len(frame), NO_OCCLUDER, dtype=np.int64)
    fraction[chosen], behind_walls[chosen] = part, part_behind
    occluder[chosen] = np.append(chosen, NO_OCCLUDER)[part_occluder]
    fraction[~in_range], occluder[~in_range], behind_walls[~in_range] = 0.0, NO_OCCLUDER, 0.0
    fraction[frame.ego] = 1.0
    return fraction, occluder, None if road.walls_xy is None else behind_walls


def states_of(settings: SensorSettings, fraction: FloatArray, in_range: BoolArray) -> npt.NDArray[np.int8]:
    """Return ``VISIBLE``, ``PARTIAL``, ``HIDDEN`` or ``OUT`` by visible fraction and reach, shape (n,)."""
    conditions = [~in_range, fraction >= settings.full_view_fraction, fraction >= settings.hidden_fraction]
    return np.select(conditions, [OUT, VISIBLE, PARTIAL], default=HIDDEN).astype(np.int8)


def _handed_out(settings: SensorSettings, memory: SensorMemory, frame: Frame, seen: _Seen) -> _Seen:
    """Return what is old enough to be handed out now; at first nothing is."""
    if settings.latency_s <= 0.0:
        return seen
    memory.pending.append((frame.time_s, seen))
    due = [k for k, (time_s, _) in enumerate(memory.pending) if time_s <= frame.time_s - settings.latency_s + 1e-6]
    if not due:
        return taken(seen, np.zeros(0, dtype=np.int64))
    late = cast("_Seen", memory.pending[due[-1]][1])
    del memory.pending[: due[-1] + 1]
    # Of a vehicle that has left meanwhile there is no truth.
    still = np.isin(late.truth_id, frame.vehicle_id)
    return _Seen(late.detections, np.where(still, late.truth_id, ""), np.where(still, late.visible_fraction, np.nan))


def _scored(settings: SensorSettings, found: Detections, true: BoolArray, memory: SensorMemory) -> Detections:
    """Return detections with scores, true ones surer; log-odds are normal, of mean +-s^2/2 and deviation s."""
    separation = settings.score_separation
    if separation == 0.0:
        return found
    mean = np.where(true, 0.5, -0.5) * separation**2
    return replace(found, score=as_score(mean + separation * memory.streams.scores.standard_normal(len(found))))


def _classified(
    settings: SensorSettings, found: Detections, origin: IntArray, frame: Frame, memory: SensorMemory
) -> Detections:
    """Return detections with classes; a false detection, which has the size of a car, is taken for one as often."""
    if settings.class_accuracy == 0.0 or frame.vehicle_class is None:
        return found
    true = np.where(origin >= 0, frame.vehicle_class[origin], CAR)
    return replace(found, vehicle_class=confused(true, settings.class_accuracy, memory.streams.classes))


def confused(vehicle_class: IntArray, accuracy: float, rng: np.random.Generator) -> IntArray:
    """Return what a detector takes vehicles for: their class with a probability, else any other; shapes (d,).

    A vehicle of unknown class stays one.
    """
    others, count = len(VEHICLE_CLASSES) - 1, len(vehicle_class)
    wrong = rng.random(count) >= accuracy
    other = (vehicle_class - 1 + rng.integers(1, others, count)) % others + 1
    return np.where(wrong & (vehicle_class != UNKNOWN_CLASS), other, vehicle_class)


def as_score(log_odds: FloatArray) -> FloatArray:
    """Return scores of log-odds as a sensor hands them out, neither 0 nor 1."""
    return np.asarray(np.clip(rounded(expit(log_odds)), LEAST_SCORE, 1.0 - LEAST_SCORE))


def own_shadows(settings: SensorSettings, detections: Detections, ego: EgoPose, road: Road) -> FreeSpace:
    """Return the sensor's own shadows for these settings."""
    return free_space(detections, ego, road, settings.range_m, float(np.deg2rad(settings.field_of_view_deg)))


def rounded(values: FloatArray) -> FloatArray:
    """Return values as a sensor hands them out."""
    return np.asarray(np.round(values, DECIMALS))


def detections_from(settings: SensorSettings, values: FloatArray, road: Road) -> Detections:
    """Return rows of ``Returns.values``, shape (d, 11), as detections, rounded as a sensor hands them out."""
    rows = rounded(values)
    rows[:, 3:10] = np.maximum(rows[:, 3:10], 10.0**-DECIMALS)
    lon, lat, speed, std_lon, std_lat, std_speed, *size, correlation = np.ascontiguousarray(rows.T)
    sizes = BodySizes(*size) if settings.std_length_m and settings.std_width_m else None
    found = Detections(lon, lat, speed, std_lon, std_lat, std_speed, sizes)
    # Along a road boxes lie along the frame's axes; in the plane they are turned every way.
    known = np.clip(correlation, -MOST_CORRELATED, MOST_CORRELATED)
    return replace(found, correlation=known) if road.has_headings else found
