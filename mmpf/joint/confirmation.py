"""Which components are reported: probable vehicles, objects that move with traffic, and objects in the ego's path."""

import numpy as np

from mmpf.belief.mixture import Components, is_longer
from mmpf.belief.moments import Moments
from mmpf.joint.overlap import overlapping
from mmpf.joint.sources import Sources
from mmpf.map.sensor_plane import SensorPlane
from mmpf.motion.state import LAT, LON
from mmpf.numerics.arrays import BoolArray, FloatArray, turned
from mmpf.options.joint import JointOptions

LOG_MOVED = float(np.log(0.01))
"""A source has moved if its speed at some time was so unlikely for one that stands."""
REPORT_ABOVE = 0.6
"""Existence probability above which a component may be reported."""
SAME_PLACE_SHARE, KNOWN_PLACE_STD_LON_M = 0.75, 1.0
"""No component is confirmed within this share of a length and a width of a confirmed one with a smaller spread."""


def least_probabilities(
    components: Components, moments: Moments, plane: SensorPlane, options: JointOptions
) -> tuple[FloatArray, FloatArray]:
    """Return the vehicle probabilities from which components are confirmed and from which they are kept, both (m,).

    In the ego's path they are 0. It is as wide as the ego and a margin on both sides, and as long as the ego needs to
    stop. On a main road they are small beside it as well, where a vehicle may be hit. In the plane they are not, since
    lanes cross there.

    Args:
        components: The components, with their sizes.
        moments: Their moments.
        plane: The plane around the sensor.
        options: Settings of the joint rule.
    """
    ego, path, kinds = plane.ego, options.path, options.kinds
    along, across = turned(moments.mean[LON] - ego.lon_m, moments.mean[LAT] - ego.lat_m, plane.ego_turn_rad)
    speed = max(ego.speed_mps, 0.0)
    length_m = path.gap_m + path.reaction_s * speed + 0.5 * speed**2 / path.braking_mps2
    width_m = 0.5 * (ego.width_m + components.width_m) + path.margin_m
    in_path = (along > 0.0) & (along < length_m) & (np.abs(across) < width_m)
    ahead = (along > -0.5 * (ego.length_m + components.length_m)) & (np.abs(across) < path.beside_m)
    ahead &= (along < length_m) & (not moments.has_headings)
    confirm = np.where(ahead, path.confirm_ahead_above, kinds.confirm_above)
    keep = np.where(ahead, path.withdraw_ahead_below, kinds.withdraw_below)
    return np.where(in_path, 0.0, confirm), np.where(in_path, 0.0, keep)


def to_confirm(components: Sources, least: FloatArray, options: JointOptions) -> BoolArray:
    """Return which components may be reported from now on, shape (m,): ``least`` is the probability to be confirmed."""
    known = components.existence > REPORT_ABOVE
    known &= is_longer(components.detected_s, options.existence.confirm_s)
    probable = components.vehicle >= least
    return np.asarray(~components.confirmed & known & (probable | moved_along(components, options)))


def still_confirmed(components: Sources, improbable: BoolArray, options: JointOptions) -> BoolArray:
    """Return which confirmed components stay so, shape (m,): those that are not ``improbable`` or have moved."""
    return np.asarray(components.confirmed & (~improbable | moved_along(components, options)))


def is_improbable(components: Sources, least: FloatArray, options: JointOptions) -> BoolArray:
    """Return which components must not be reported, shape (m,): ``least`` is the probability to be kept."""
    moved = np.minimum(least, options.kinds.withdraw_moved_below)
    return np.asarray(components.vehicle_share < np.where(moved_along(components, options), moved, least))


def moved_along(components: Sources, options: JointOptions) -> BoolArray:
    """Return which components have moved and been detected for so long that they stay confirmed, shape (m,).

    Few false objects move, and they end soon: a vehicle that came into view unnoticed must not wait until the odds of
    its kind have grown. It is reported with its probability unless it is improbable.
    """
    moved = components.stood_log < LOG_MOVED
    return np.asarray(moved & is_longer(components.detected_s, options.kinds.moved_s))


def stands_on_another(components: Components, moments: Moments) -> BoolArray:
    """Return which components overlap a confirmed, well localised one: they may not be confirmed."""
    blocks = components.confirmed & (moments.std_along_m < KNOWN_PLACE_STD_LON_M)
    overlaps = overlapping(components, moments, SAME_PLACE_SHARE)
    return np.asarray((overlaps & blocks[None, :]).any(axis=1))
