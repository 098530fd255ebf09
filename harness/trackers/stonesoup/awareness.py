"""What a tracker can know of its own tracks beyond their states: sizes, who hides whom, and who follows whom.

Nothing here is told by the truth: sizes are measured, and shadows and leaders are those of the other tracks.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from stonesoup.types.detection import Detection
from stonesoup.types.multihypothesis import MultipleHypothesis
from stonesoup.types.track import Track
from stonesoup.types.update import Update

from harness.trackers.shadows import POINTS, Visibility, detection_probabilities
from harness.trackers.stonesoup.options import AwareJpdaOptions
from harness.trackers.stonesoup.parts import MEASURED_SIZE, to_seconds
from mmpf.map.road import Road
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion.idm import LONGEST_HEADWAY_S, SHORTEST_HEADWAY_S, SLOWEST_MPS, adaptive_parameters, idm_acceleration
from mmpf.motion.protocol import Neighbour
from mmpf.numerics.arrays import BoolArray, FloatArray
from mmpf.options.filter import Footprint
from mmpf.scan import EgoPose, Scan, SensorModel
from mmpf.surroundings.neighbours import IN_THE_WAY
from mmpf.visibility.depth import Bodies, depth_table

_SMALLEST_SIZE_STD_M = 0.05


@dataclass(frozen=True)
class SizeBelief:
    """A size as it is believed: length and width.

    Attributes:
        mean_m: Mean length and width.
        variance_m2: Their variances.
    """

    mean_m: tuple[float, float]
    variance_m2: tuple[float, float]

    @classmethod
    def unmeasured(cls, vehicle: Footprint) -> SizeBelief:
        """Return what is believed of a vehicle that was never measured."""
        return cls((vehicle.length_m, vehicle.width_m), (vehicle.std_length_m**2, vehicle.std_width_m**2))

    def measured(self, measurement: Iterable[tuple[float, float]]) -> SizeBelief:
        """Return the belief after a measurement: of the length and of the width, each with its standard deviation."""
        means, variances = [], []
        for mean, variance, (value, std) in zip(self.mean_m, self.variance_m2, measurement, strict=True):
            gain = variance / (variance + std**2)
            means.append(mean + gain * (value - mean))
            # Errors of sizes repeat themselves: no number of measurements makes a size known exactly.
            variances.append(max((1.0 - gain) * variance, _SMALLEST_SIZE_STD_M**2))
        return SizeBelief((means[0], means[1]), (variances[0], variances[1]))


@dataclass
class TrackKnowledge:
    """What is known of one track beyond its state.

    Attributes:
        size: Its vehicle's size.
        detection_probability: Of the present scan, seen from the ego past the other tracks.
        missed: Detections of it that were to be expected since the last one.
        headway_s: The driver's time headway, as last seen; None if nobody was ahead of it then.
        accel_mps2: Acceleration with which it follows its leader unseen; zero while it is seen.
    """

    size: SizeBelief
    detection_probability: float
    missed: float = 0.0
    headway_s: float | None = None
    accel_mps2: float = 0.0


@dataclass
class Awareness:
    """What is known of all tracks of a tracker, brought up to date before and after each scan.

    Attributes:
        options: The tracker's settings.
        sensor: The sensor's data sheet.
        road: Where the road leads.
        of: What is known, by the track's number.
    """

    options: AwareJpdaOptions
    sensor: SensorModel
    road: Road
    of: dict[int, TrackKnowledge] = field(default_factory=dict)

    def look_ahead(self, scan: Scan, tracks: list[Track]) -> None:
        """Work out what can be detected in a scan and who follows whom, from the tracks before it."""
        if not tracks:
            return
        scene = self._scene(scan, tracks)
        probabilities = self._detection_probabilities(SensorPlane(scan.ego, self.road), scene)
        for track, probability in zip(tracks, probabilities.tolist(), strict=True):
            self.of[track.id].detection_probability = probability
        self._follow_leaders(scan.ego, scene, tracks)

    def learn(self, time_s: float, tracks: list[Track]) -> None:
        """Take in what the tracks were updated with, and forget those that ended."""
        self.of = {track.id: self._learned(time_s, track) for track in tracks}

    def _learned(self, time_s: float, track: Track) -> TrackKnowledge:
        known = self.of.get(track.id)
        if known is None:
            size = SizeBelief.unmeasured(self.options.vehicle)
            known = TrackKnowledge(_measured(size, track.states), self._in_plain_view)
        elif to_seconds(track.state.timestamp) == time_s and isinstance(track.state, Update):
            known.size, known.missed = _measured(known.size, [track.state]), 0.0
        else:
            known.missed += known.detection_probability
        return known

    @property
    def _in_plain_view(self) -> float:
        chosen = self.options.detection_probability
        return self.sensor.detection_probability if chosen is None else chosen

    def _scene(self, scan: Scan, tracks: list[Track]) -> _Scene:
        layout = self.options.layout
        mean = np.array([np.asarray(track.state.mean, dtype=float).ravel() for track in tracks])
        std_lon = [float(np.sqrt(max(track.state.covar[layout.lon, layout.lon], 0.0))) for track in tracks]
        ahead_s = np.array([scan.time_s - to_seconds(track.state.timestamp) for track in tracks])
        sizes = np.array([self.of[track.id].size.mean_m for track in tracks])
        return _Scene(
            mean[:, layout.lon] + ahead_s * mean[:, layout.speed],
            mean[:, layout.lat] + ahead_s * mean[:, layout.lat_speed],
            mean[:, layout.speed],
            np.array(std_lon),
            np.array([scan.time_s - _last_seen_s(track) for track in tracks]),
            Bodies(sizes[:, 0], sizes[:, 1]),
        )

    def _detection_probabilities(self, plane: SensorPlane, scene: _Scene) -> FloatArray:
        """Return the mean detection probability over where each track may be along the road, shape (m,)."""
        casts_shadow = scene.unseen_s <= self.options.occluder_unseen_s + 1e-6
        table = depth_table(plane, scene.lon_m, scene.lat_m, casts_shadow, scene.bodies)
        points = len(POINTS)
        lon = (scene.lon_m[:, None] + scene.std_lon_m[:, None] * POINTS).ravel()
        lat = np.repeat(scene.lat_m, points)
        component = np.repeat(np.arange(len(scene.lon_m)), points)
        visibility = Visibility(self.sensor, self._in_plain_view, self.options.hidden_probability)
        return detection_probabilities(plane, (lon, lat, component), scene.bodies, table, visibility)

    def _follow_leaders(self, ego: EgoPose, scene: _Scene, tracks: list[Track]) -> None:
        driver, adaptation = adaptive_parameters()
        leader = leaders(ego, scene)
        free = 1.0 - np.minimum(scene.speed_mps / driver.desired_speed_mps, 1.0) ** driver.exponent
        braking_scale = 2.0 * np.sqrt(driver.max_accel_mps2 * driver.comfortable_decel_mps2)
        closing_m = scene.speed_mps * (scene.speed_mps - leader.speed_mps) / braking_scale
        gap_m = np.where(leader.exists, np.clip(leader.gap_m, 0.1, 200.0), 0.1)
        spare_m = gap_m * np.sqrt(np.maximum(free, 1e-3)) - driver.standstill_gap_m - closing_m
        implied = np.clip(spare_m / np.maximum(scene.speed_mps, SLOWEST_MPS), SHORTEST_HEADWAY_S, LONGEST_HEADWAY_S)
        common = driver.time_headway_s
        implied = common + adaptation.trust * (implied - common)
        is_unseen = scene.unseen_s > self.options.follow_after_s + 1e-6
        known = [self.of[track.id] for track in tracks]
        for k in np.flatnonzero(~is_unseen).tolist():
            known[k].headway_s = float(implied[k]) if leader.exists[k] else None
        headway = np.array([common if each.headway_s is None else each.headway_s for each in known])
        wanted = idm_acceleration(np.maximum(scene.speed_mps, 0.0), leader, driver, headway)
        # A driver with nobody ahead keeps its speed: how fast it would like to go is not known.
        accel = np.where(is_unseen & leader.exists, np.minimum(wanted, driver.max_accel_mps2), 0.0)
        for each, value in zip(known, accel.tolist(), strict=True):
            each.accel_mps2 = value


@dataclass(frozen=True)
class _Scene:
    """The tracks as they should be at a scan, struct of arrays, each of shape (m,)."""

    lon_m: FloatArray
    lat_m: FloatArray
    speed_mps: FloatArray
    std_lon_m: FloatArray
    unseen_s: FloatArray
    bodies: Bodies


def leaders(ego: EgoPose, scene: _Scene) -> Neighbour:
    """Return the nearest vehicle ahead of each track that is in its way, another track or the ego itself."""
    bodies = scene.bodies
    lon, lat = np.append(scene.lon_m, ego.lon_m), np.append(scene.lat_m, ego.lat_m)
    length, width = np.append(bodies.length_m, ego.length_m), np.append(bodies.width_m, ego.width_m)
    speed = np.append(scene.speed_mps, ego.speed_mps)
    rows = np.arange(len(scene.lon_m))
    ahead_m = lon - scene.lon_m[:, None]
    is_in_the_way: BoolArray = np.abs(lat - scene.lat_m[:, None]) < IN_THE_WAY * 0.5 * (width + bodies.width_m[:, None])
    distance = np.where((ahead_m > 0.0) & is_in_the_way, ahead_m, np.inf)
    nearest = distance.argmin(axis=1)
    exists = np.isfinite(distance[rows, nearest])
    gap_m = distance[rows, nearest] - 0.5 * (length[nearest] + bodies.length_m)
    return Neighbour(
        exists,
        gap_m,
        np.where(exists, speed[nearest], scene.speed_mps),
        np.zeros(len(rows)),
        np.where(exists, length[nearest], bodies.length_m),
    )


def _last_seen_s(track: Track) -> float:
    return to_seconds(next(state for state in reversed(track.states) if isinstance(state, Update)).timestamp)


def _measured(size: SizeBelief, states: Iterable[object]) -> SizeBelief:
    """Return the belief after the detections that some states of a track were updated with."""
    for state in states:
        detection = _most_probable(state.hypothesis) if isinstance(state, Update) else None
        measurement = None if detection is None else detection.metadata.get(MEASURED_SIZE)
        if measurement is not None:
            size = size.measured(measurement)
    return size


def _most_probable(hypothesis: object) -> Detection | None:
    if not isinstance(hypothesis, MultipleHypothesis):
        return hypothesis.measurement  # type: ignore[attr-defined]
    best = max((each for each in hypothesis if each), key=lambda each: each.probability, default=None)
    return None if best is None else best.measurement
