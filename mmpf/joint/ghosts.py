"""Is it a vehicle, or a false object that stays: reflections and wayside things give detections again and again.

Existence says whether there is a source of detections; what is weighed here is what kind of source. A false object
appears anywhere, while a vehicle comes in from the edge of the range or out of a shadow; it is detected less regularly,
does not last, and mostly stands still. Log odds of the two kinds are kept beside each component's particles.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mmpf.around.depth import Bodies, depth_table
from mmpf.around.detectability import in_plain_view
from mmpf.around.reach import share_at
from mmpf.around.shadows import visible_fractions
from mmpf.cloud.birth import Traffic, local_speed
from mmpf.cloud.mixture import Components, Mixture
from mmpf.cloud.moments import Moments
from mmpf.compute.arrays import BoolArray, FloatArray, IntArray
from mmpf.joint.overlap import overlapping
from mmpf.joint_options import JointFalseObjects, JointGhosts, JointOptions, JointRegularity
from mmpf.lanes.graph import LaneGraph
from mmpf.options import FilterOptions
from mmpf.scan import SensorModel
from mmpf.state import LAT, LON, SPEED
from mmpf.update import Situation

LARGEST_LOG_ODDS = 6.0
# Vehicles queue so far before a stop line.
QUEUE_M = 50.0


@dataclass(frozen=True)
class Sightings:
    """What a scan says of each of m components, whatever kind of source they are.

    Attributes:
        hit: Probability that the component was detected, shape (m,).
        not_seen: Probability that a vehicle gives no detection there, shape (m,).
        run_probability: Probability of being in a run of misses, before the scan, shape (m,).
        shadow_wrong: Probability that a vehicle there is seen as in plain view, before the scan, shape (m,).
        reach: What remains of the data sheet's detection probability at its distance, shape (m,).
    """

    hit: FloatArray
    not_seen: FloatArray
    run_probability: FloatArray
    shadow_wrong: FloatArray
    reach: FloatArray

    def in_plain_view(self, sensor: SensorModel) -> FloatArray:
        """Return the probability that a vehicle would be detected if no shadow lay on it, shape (m,)."""
        return np.maximum(1.0 - self.run_probability, 1e-3) * in_plain_view(sensor, self.reach)

    def of_false_objects(self, options: JointFalseObjects) -> FloatArray:
        """Return the probability that a false object would be detected: distance takes its share of it too, (m,)."""
        return options.seen_probability * np.minimum(self.reach, 1.0)

    def of_vehicles(self, sensor: SensorModel) -> FloatArray:
        """Return the probability that a vehicle would be detected, right shadows and wrong ones together, (m,)."""
        by_shadows = 1.0 - self.not_seen
        return by_shadows + self.shadow_wrong * (self.in_plain_view(sensor) - by_shadows)


def first_log_odds(count: int, options: JointGhosts) -> FloatArray:
    """Return the log odds of the components of the first scan: nobody had been looking, shape (count,)."""
    return np.full(count, _log_odds(options.vehicle_out_of_view))


def log_odds_at_birth(
    chosen: IntArray, mixture: Mixture, moments: Moments, situation: Situation, options: FilterOptions
) -> FloatArray:
    """Return the log odds that what appears here is a vehicle: low in plain view, where one would be known, shape (k,).

    Args:
        chosen: The detections that something new is started from, shape (k,).
        mixture: The belief, whose vehicles cast shadows.
        moments: Its components' moments.
        situation: The scan and the sensor's data sheet.
        options: The filter's settings.
    """
    if len(chosen) == 0:
        return np.zeros(0)
    ghosts, sensor, plane, vehicle = options.joint.ghosts, situation.sensor, situation.plane, options.vehicle
    lon, lat = situation.scan.detections.lon_m[chosen], situation.scan.detections.lat_m[chosen]
    components, nobody = mixture.components, len(mixture)
    length, width = np.append(components.length_m, vehicle.length_m), np.append(components.width_m, vehicle.width_m)
    bodies = Bodies(length, width, np.append(moments.heading_rad, 0.0))
    casts = np.append(is_vehicle(components) & components.confirmed, values=False)
    table = depth_table(plane, np.append(moments.mean[LON], 0.0), np.append(moments.mean[LAT], 0.0), casts, bodies)
    visible = visible_fractions(plane, lon, lat, np.full(len(chosen), nobody), bodies, table)
    in_view = np.clip((visible - sensor.hidden_fraction) / (sensor.full_view_fraction - sensor.hidden_fraction), 0, 1)
    distance = plane.distance_m(lon, lat)
    in_view *= np.clip((sensor.range_m - distance) / ghosts.edge_m - 0.5, 0.0, 1.0)
    shares = situation.reach.shares(options.joint.reach.prior_scans)
    in_view *= np.minimum(share_at(distance, shares, situation.reach.ring_m), 1.0)
    return _log_odds(ghosts.vehicle_out_of_view + in_view * (ghosts.vehicle_in_view - ghosts.vehicle_out_of_view))


def with_log_odds(
    components: Components,
    before: Components,
    moments: Moments,
    sightings: Sightings,
    situation: Situation,
    options: FilterOptions,
) -> Components:
    """Return the components with the log odds after a scan.

    Args:
        components: The components, otherwise as they are after the scan.
        before: The components before it.
        moments: Their moments before it.
        sightings: What the scan says of them.
        situation: The scan, the sensor's data sheet and the traffic around.
        options: The filter's settings.
    """
    ghosts, false_objects = options.joint.ghosts, options.joint.false_objects
    odds = before.source_log_odds + regularity_log_odds(
        sightings, before.unseen_s, situation.sensor, options.joint, situation.dt_s
    )
    seen = before.unseen_s <= options.reporting.hidden_after_s
    odds += overlap_log_odds(before, moments, seen, ghosts, situation.dt_s)
    odds = np.clip(odds, -LARGEST_LOG_ODDS, LARGEST_LOG_ODDS)
    waits = waiting_shares(moments, situation.plane.road.graph, false_objects)
    stood = stood_log_after(before.stood_log, moments, false_objects)
    by_speed = speed_log_odds(moments, situation.traffic, false_objects, options.birth.local_range_m, waits, stood)
    return replace(
        components,
        source_log_odds=odds,
        vehicle_log_odds=odds + by_speed,
        stood_log=stood,
        shadow_wrong=shadow_wrong_after(sightings, situation.sensor, options.joint.regularity, situation.dt_s),
    )


def regularity_log_odds(
    sightings: Sightings,
    unseen_s: FloatArray,
    sensor: SensorModel,
    options: JointOptions,
    dt_s: float,
) -> FloatArray:
    """Return what a scan adds to the log odds: vehicles are detected more regularly, and they last, shape (m,).

    Args:
        sightings: What the scan says.
        unseen_s: Time since the last detection before this scan, shape (m,).
        sensor: The sensor's data sheet.
        options: How false objects behave, and what regularity is worth.
        dt_s: Time since the scan before.
    """
    false, regularity = options.false_objects, options.regularity
    vehicle_seen = sightings.of_vehicles(sensor)
    false_seen = sightings.of_false_objects(false)
    seen = np.log(np.maximum(vehicle_seen, 1e-3) / false_seen) + dt_s / false.life_s
    # A false object that is not seen for a few scans is usually gone: who returns after them is a vehicle.
    missed_scans = np.clip(unseen_s / dt_s - 1.0, 0.0, regularity.largest_gap_scans)
    in_view = np.clip((1.0 - sightings.not_seen) / sightings.in_plain_view(sensor), 0.0, 1.0)
    seen = seen - regularity.gap_credit * in_view**2 * missed_scans * np.log(1.0 - false_seen)
    missed = np.log(np.maximum(1.0 - vehicle_seen, 1e-3) / (1.0 - false_seen))
    return np.asarray(
        sightings.hit * seen + (1.0 - sightings.hit) * np.minimum(missed, regularity.largest_miss_log_odds)
    )


def shadow_wrong_after(sightings: Sightings, sensor: SensorModel, options: JointRegularity, dt_s: float) -> FloatArray:
    """Return the probability that shadows are wrong for each component, at the next scan, by Bayes' rule, shape (m,).

    Args:
        sightings: What the scan says.
        sensor: The sensor's data sheet.
        options: How often shadows are wrong, and for how long.
        dt_s: Time to the next scan.
    """
    plain_view, seen = sightings.in_plain_view(sensor), sightings.of_vehicles(sensor)
    by_hit = plain_view / np.maximum(seen, 1e-3)
    by_miss = (1.0 - plain_view) / np.maximum(1.0 - seen, 1e-3)
    after = sightings.shadow_wrong * (sightings.hit * by_hit + (1.0 - sightings.hit) * by_miss)
    forgotten = -np.expm1(-dt_s / options.shadow_wrong_s)
    return np.asarray(np.clip(after + forgotten * (options.shadow_wrong - after), 0.0, 1.0))


def waiting_shares(moments: Moments, graph: LaneGraph | None, options: JointFalseObjects) -> FloatArray | float:
    """Return which share of vehicles stands where each component is: shape (m,) where stop lines are known."""
    if graph is None:
        return 0.0
    if graph.control is None:
        return options.waiting_share
    x, y = moments.mean[LON], moments.mean[LAT]
    lane = graph.lane_at(x, y, moments.heading_rad)
    along, _, _ = graph.on_lane(lane, x, y)
    to_line = np.where(lane >= 0, graph.length_m[lane] - along + graph.to_stop_line_m[lane], np.inf)
    return np.where(to_line < QUEUE_M, options.waiting_share_at_line, options.waiting_share_elsewhere)


def stood_log_after(before: FloatArray, moments: Moments, options: JointFalseObjects) -> FloatArray:
    """Return how well the speeds so far fit one that always stood, shape (m,); those hardly known say nothing.

    Args:
        before: The same before this scan, shape (m,).
        moments: The components' moments.
        options: What false objects are like.
    """
    variance = moments.variance[SPEED]
    standing = -0.5 * moments.mean[SPEED] ** 2 / (variance + options.standing_std_mps**2)
    return np.where(variance <= options.standing_std_mps**2, np.minimum(before, standing), before)


def speed_log_odds(
    moments: Moments,
    traffic: Traffic,
    options: JointFalseObjects,
    range_m: float,
    waits: FloatArray | float,
    stood_log: FloatArray | float = 0.0,
) -> FloatArray:
    """Return what the speeds say: most false objects stand, while vehicles swim in the traffic, shape (m,).

    A vehicle may brake to a stop amid flowing traffic, and is then in everybody's way; what was seen to move is none of
    those that stand for good.

    Args:
        moments: The components' moments.
        traffic: Speeds of the vehicles around.
        options: What false objects are like.
        range_m: How far the traffic around reaches.
        waits: Share of vehicles that stand though others flow, shape (m,) or for all.
        stood_log: How well the speeds so far fit one that always stood, shape (m,); see ``stood_log_after``.
    """
    speed, variance = moments.mean[SPEED], moments.variance[SPEED]
    flow = local_speed(moments.mean[LON], moments.mean[LAT], traffic, range_m)
    flowing = _normal(speed - flow, variance + options.flow_std_mps**2)
    standing = _normal(speed, variance + options.standing_std_mps**2)
    vehicle = waits * standing + (1.0 - waits) * flowing
    slowest = _normal(np.zeros_like(speed), variance + options.standing_std_mps**2)
    always_stood = np.minimum(standing, slowest * np.exp(stood_log))
    false = options.standing_share * always_stood + (1.0 - options.standing_share) * flowing
    return np.log(np.maximum(vehicle, 1e-12) / np.maximum(false, 1e-12))


def overlap_log_odds(
    components: Components, moments: Moments, is_seen: BoolArray, options: JointGhosts, dt_s: float
) -> FloatArray:
    """Return what two seen sources in one place say: the one that was less of a vehicle is none, shape (m,)."""
    odds = components.vehicle_log_odds
    overlaps = overlapping(components, moments, options.overlap_share)
    overlaps &= is_seen[:, None] & is_seen & (odds[:, None] < odds)
    return np.where(overlaps.any(axis=1), -options.overlap_per_s * dt_s, 0.0)


def is_vehicle(components: Components) -> BoolArray:
    """Return which components are vehicles rather than false objects, shape (m,)."""
    return np.asarray(components.vehicle_log_odds > 0.0)


def _normal(difference: FloatArray, variance: FloatArray) -> FloatArray:
    return np.asarray(np.exp(-0.5 * difference**2 / variance) / np.sqrt(variance))


def _log_odds(probability: FloatArray | float) -> FloatArray:
    return np.asarray(np.log(probability) - np.log1p(-np.asarray(probability)))
