"""The prior kind of a new component: vehicles come out of shadows or enter the range."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from mmpf.belief.mixture import Mixture
from mmpf.belief.moments import Moments
from mmpf.joint.false_objects import FalseObjects
from mmpf.joint.kinds import (
    DETECTABILITY,
    FALSE,
    SHADING,
    SHAPE,
    VEHICLE,
    bounded,
    normalised,
    shares_of,
)
from mmpf.joint.known import Known
from mmpf.joint.sources import Sources
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.options.filter import FilterOptions
from mmpf.options.joint import JointOptions
from mmpf.scan import SensorModel
from mmpf.stages.update_rule import Situation
from mmpf.visibility.depth import Occluders, depth_table
from mmpf.visibility.field import share_in_field
from mmpf.visibility.range_profile import share_at
from mmpf.visibility.shadows import visible_fractions

OVERLOOKED_S = 0.4
"""For so long those were overlooked who are first detected in plain view."""
# Vehicles pass each other at this speed though the ego stands.
SLOWEST_PASSING_MPS = 7.0
OUT_OF_VIEW_PER_S, IN_SHADOW = 4.0, 0.1
"""Rate of vehicles that are first detected at the edge of a shadow or of the range, or in the first scan, and the
factor on a rate deep in a shadow, where no vehicle should be detected."""
RANGE_EDGE_M = 8.0
"""Least width of the zone at the edge of the range."""
FIRST_LOOK_S = 1.0
"""Time after the first scan until the vehicles in plain view have been detected."""
SHADOW_EDGE_S = 0.5
"""Time for which a vehicle may have left a shadow, or entered the range, before it is detected; the ego passes
standing vehicles at its own speed."""
LEAST_PRIOR = 0.02
"""Smallest prior probability of either kind, at any place of appearance."""


@dataclass(frozen=True)
class Appearances:
    """Where k new sources appear.

    Attributes:
        in_view: Degree, 0 to 1, to which a vehicle would have been known there before, shape (k,).
        in_view_standing: The same of a vehicle that stands, which the ego passes at its own speed, shape (k,).
        seen_share: Detection probability there, given the shadows, over that in plain view, shape (k,).
        scan_s: Time from scan to scan.
    """

    in_view: FloatArray
    in_view_standing: FloatArray
    seen_share: FloatArray
    scan_s: float

    def standing_ratio(self, in_view_per_s: float) -> FloatArray:
        """Return how many times more often standing than moving vehicles appear there, at least 1, shape (k,)."""
        moving, standing = (_rate(degree, in_view_per_s) for degree in (self.in_view, self.in_view_standing))
        return np.asarray(standing / moving)

    @classmethod
    def unwatched(cls, count: int) -> Self:
        """Return places of the first scan: nothing was observed before, so vehicles can be anywhere."""
        return cls(np.zeros(count), np.zeros(count), np.ones(count), OVERLOOKED_S)


def kinds_at_birth(
    places: Appearances, learned: FalseObjects, sensor: SensorModel, options: JointOptions
) -> FloatArray:
    """Return each new source's joint probability of kind, shading and detectability, given that it was detected once.

    It is proportional to the rate at which such sources are first detected there: vehicles by the degree of plain view,
    false objects as often as they were found so far. A vehicle first detected in plain view is probably hard to detect.

    Args:
        places: Where they appear, k of them.
        learned: What false objects are like.
        sensor: The sensor's data sheet.
        options: Settings of the joint rule.

    Returns:
        Probabilities that sum to one for each, shape (k, *SHAPE).
    """
    kinds = np.zeros((len(places.in_view), *SHAPE))
    vehicles, newborn, false_objects = options.vehicles, options.newborn, options.false_objects
    usual = learned.vehicle_profile(vehicles) * DETECTABILITY
    overlooked = usual * (1.0 - np.minimum(DETECTABILITY, 0.99)) ** (OVERLOOKED_S / places.scan_s)
    late = newborn.overlooked_share * places.in_view
    profile = (1.0 - late)[:, None] * usual / usual.sum() + late[:, None] * overlooked / overlooked.sum()
    shadow = _by_shading(learned.vehicle_shading(vehicles), places.seen_share)
    kinds[:, VEHICLE] = (shadow / shadow.sum(axis=1, keepdims=True))[:, :, None] * profile[:, None]
    if options.kinds.weighed:
        stopped, in_view_per_s = options.speeds.stopped_on_road, newborn.in_view_per_s
        rate = _rate(places.in_view, learned.vehicles_in_view_per_s(in_view_per_s))
        rate *= 1.0 - stopped + stopped * places.standing_ratio(in_view_per_s)
        rate *= IN_SHADOW + (1.0 - IN_SHADOW) * places.seen_share
        kinds[:, VEHICLE] *= rate[:, None, None]
        profiles = learned.profiles(false_objects) * DETECTABILITY
        profiles *= (learned.kind_shares(false_objects) / profiles.sum(axis=1))[:, None]
        profiles *= learned.births_per_s(sensor, false_objects)
        shadow = _by_shading(false_objects.shading, places.seen_share)
        kinds[:, FALSE] = shadow[:, None, :, None] * profiles[:, None]
    kinds = normalised(kinds)
    return bounded(kinds, LEAST_PRIOR) if options.kinds.weighed else kinds


def newborn_sources(
    track_id: IntArray,
    existence: FloatArray,
    places: Appearances,
    learned: FalseObjects,
    sensor: SensorModel,
    options: FilterOptions,
) -> Sources:
    """Return new components of those identities and existence probabilities, shape (k,); see ``kinds_at_birth``."""
    return Sources.newborn(track_id, existence, options.vehicle).having(
        kinds=kinds_at_birth(places, learned, sensor, options.joint),
        standing_ratio=places.standing_ratio(options.joint.newborn.in_view_per_s),
        born_in_view=places.in_view,
    )


def _rate(in_view: FloatArray, in_view_per_s: float) -> FloatArray:
    """Return the vehicles per second that appear in places of a degree of plain view, shape (k,)."""
    return np.asarray(OUT_OF_VIEW_PER_S ** (1.0 - in_view) * in_view_per_s**in_view)


def _by_shading(shares: Sequence[float] | FloatArray, seen_share: FloatArray) -> FloatArray:
    """Return the unnormalised probability of each shading given a first detection, shape (k, 3)."""
    return np.asarray(shares_of(shares) * np.maximum(seen_share, 1e-3)[:, None] ** SHADING)


def appearances_at(
    chosen: IntArray, mixture: Mixture, moments: Moments, known: Known, situation: Situation, options: FilterOptions
) -> Appearances:
    """Return the places of the detections that start new sources.

    Args:
        chosen: The detections that something new is started from, shape (k,).
        mixture: The belief, whose vehicles cast shadows.
        moments: Its components' moments.
        known: What the rule has learned of the sensor.
        situation: The scan.
        options: The filter's settings.
    """
    if len(chosen) == 0:
        return Appearances.unwatched(0)
    sensor, plane, vehicle = known.sensor, situation.plane, options.vehicle
    lon, lat = situation.scan.detections.lon_m[chosen], situation.scan.detections.lat_m[chosen]
    components, nobody = mixture.components, len(mixture)
    # Whoever was at one of the detections headed as its lane does, and hides nobody.
    ahead = plane.road.axis_of(np.nan_to_num(plane.road.lane_heading_at(lon, lat)))
    each = np.ones(len(chosen))
    length = np.append(components.length_m, vehicle.length_m * each)
    width = np.append(components.width_m, vehicle.width_m * each)
    bodies = Occluders(length, width, np.append(moments.heading_rad, ahead))
    casts = np.append((components.vehicle_share > 0.5) & components.confirmed, np.zeros(len(chosen), dtype=np.bool_))
    table = depth_table(plane, np.append(moments.mean[LON], lon), np.append(moments.mean[LAT], lat), casts, bodies)

    half_width = np.full(len(chosen), 0.25 * (vehicle.length_m + vehicle.width_m))

    def visible(ahead_m: float) -> FloatArray:
        """Return the visible fraction of a vehicle so far ahead of each detection along its lane."""
        place = lon + ahead_m * np.cos(ahead), lat + ahead_m * np.sin(ahead)
        seen = visible_fractions(plane, *place, nobody + np.arange(len(chosen)), bodies, table)
        in_field = share_in_field(plane, *place, half_width, situation.scan.free_space)
        return seen if in_field is None else np.minimum(seen, in_field)

    here = visible(0.0)
    distance = plane.distance_m(lon, lat)
    shares = known.reach.shares()
    watched = np.minimum(share_at(distance, shares, known.reach.ring_m), 1.0)
    # Who is rarely detected has not been found in the first scans.
    watched *= -np.expm1(-known.false_objects.since_start_s / FIRST_LOOK_S)

    def in_view(passing_mps: float) -> FloatArray:
        """Return the degree of plain view for vehicles that pass the ego at a speed."""
        edge_m = SHADOW_EDGE_S * passing_mps
        before = np.minimum(here, np.minimum(visible(edge_m), visible(-edge_m)))
        inside = np.clip((sensor.range_m - distance) / max(RANGE_EDGE_M, edge_m) - 0.5, 0.0, 1.0)
        in_sight = (before - sensor.hidden_fraction) / (sensor.full_view_fraction - sensor.hidden_fraction)
        return np.asarray(inside * watched * np.clip(in_sight, 0.0, 1.0))

    moving = in_view(SLOWEST_PASSING_MPS)
    standing = np.minimum(moving, in_view(max(abs(plane.ego.speed_mps), SLOWEST_PASSING_MPS)))
    seen = np.where(here < sensor.hidden_fraction, options.joint.detectability.hidden_probability, here)
    return Appearances(moving, standing, np.minimum(seen / sensor.full_view_fraction, 1.0), situation.dt_s)
