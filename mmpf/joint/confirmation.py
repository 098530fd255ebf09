"""Which components are reported: probable vehicles, objects that move with traffic, and objects in the ego's path."""

from __future__ import annotations

import numpy as np

from mmpf.belief.mixture import Components, is_longer
from mmpf.belief.moments import Moments
from mmpf.joint.overlap import overlapping
from mmpf.joint.sources import Sources
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import BoolArray, turned
from mmpf.options.joint import JointOptions, JointPath

LOG_MOVED = float(np.log(0.01))
"""A source has moved if its speed at some time was so unlikely for one that stands."""
REPORT_ABOVE = 0.6
"""Existence probability above which a component may be reported."""
SAME_PLACE_SHARE, KNOWN_PLACE_STD_LON_M = 0.75, 1.0
"""No component is confirmed within this share of a length and a width of a confirmed one with a smaller spread."""


def to_confirm(components: Sources, in_path: BoolArray, options: JointOptions) -> BoolArray:
    """Return which components may be reported from now on, shape (m,).

    Args:
        components: The components.
        in_path: Which lie in the ego's path: these are reported with any probability of a vehicle, shape (m,).
        options: Settings of the joint rule.
    """
    known = components.existence > REPORT_ABOVE
    known &= is_longer(components.detected_s, options.existence.confirm_s)
    probable = components.vehicle > options.kinds.confirm_above
    return np.asarray(~components.confirmed & known & (probable | in_path | moved_along(components, options)))


def still_confirmed(components: Sources, improbable: BoolArray, options: JointOptions) -> BoolArray:
    """Return which confirmed components stay so, shape (m,): those that are not ``improbable`` or have moved."""
    return np.asarray(components.confirmed & (~improbable | moved_along(components, options)))


def is_improbable(components: Sources, in_path: BoolArray, options: JointOptions) -> BoolArray:
    """Return which components must not be reported, shape (m,); arguments are those of ``to_confirm``."""
    least = np.where(moved_along(components, options), options.kinds.withdraw_moved_below, options.kinds.withdraw_below)
    return np.asarray(~in_path & (components.vehicle_share < least))


def moved_along(components: Sources, options: JointOptions) -> BoolArray:
    """Return which components have moved and been detected for so long that they stay confirmed, shape (m,).

    Few false objects move, and they end soon: a vehicle that came into view unnoticed must not wait until the odds of
    its kind have grown. It is reported with its probability unless it is improbable.
    """
    moved = components.stood_log < LOG_MOVED
    return np.asarray(moved & is_longer(components.detected_s, options.kinds.moved_s))


def lies_in_path(components: Components, moments: Moments, plane: SensorPlane, options: JointPath) -> BoolArray:
    """Return which components lie in the ego's path, shape (m,).

    The path is as wide as the ego and a margin on both sides, and as long as the ego needs to stop.

    Args:
        components: The components, with their sizes.
        moments: Their moments.
        plane: The plane around the sensor.
        options: How wide and how long the path is.
    """
    ego = plane.ego
    along, across = turned(moments.mean[LON] - ego.lon_m, moments.mean[LAT] - ego.lat_m, plane.ego_turn_rad)
    speed = max(ego.speed_mps, 0.0)
    length_m = options.gap_m + options.reaction_s * speed + 0.5 * speed**2 / options.braking_mps2
    width_m = 0.5 * (ego.width_m + components.width_m) + options.margin_m
    return np.asarray((along > 0.0) & (along < length_m) & (np.abs(across) < width_m))


def stands_on_another(components: Components, moments: Moments) -> BoolArray:
    """Return which components overlap a confirmed, well localised one: they may not be confirmed."""
    blocks = components.confirmed & (moments.std_along_m < KNOWN_PLACE_STD_LON_M)
    overlaps = overlapping(components, moments, SAME_PLACE_SHARE)
    return np.asarray((overlaps & blocks[None, :]).any(axis=1))
