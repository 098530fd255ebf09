"""Which vehicles are truly hidden from a car's sensor. Only the choice of episodes uses it, never a belief."""

from collections.abc import Sequence
from dataclasses import replace

from harness.closedloop.traffic import row_of
from harness.config.sensor import SensorSettings
from harness.sensor.detector import visibility_of
from harness.sensor.scene import in_reach, sight_to
from harness.truth.frame import Frame
from mmpf.map.road import Road

SEEN_EVERY, SEEN_OFTEN = 5, 3
"""A hidden vehicle has been seen if it was in sight at so many of every fifth frame of the tracking seconds."""


def hidden_after_sight(frames: Sequence[Frame], ego: str, name: str, road: Road, settings: SensorSettings) -> bool:
    """Return whether a vehicle is hidden in the last frame and was in sight often enough before."""
    if not is_hidden(frames[-1], ego, name, road, settings):
        return False
    return moments_in_sight(frames, ego, name, road, settings) >= SEEN_OFTEN


def moments_in_sight(frames: Sequence[Frame], ego: str, name: str, road: Road, settings: SensorSettings) -> int:
    """Return at how many of every fifth frame before the last a vehicle was in sight."""
    return sum(not is_hidden(frame, ego, name, road, settings) for frame in frames[:-1:SEEN_EVERY])


def is_hidden(frame: Frame, ego: str, name: str, road: Road, settings: SensorSettings) -> bool:
    """Return whether less of a vehicle is to be seen than the sensor needs, by true visible fraction."""
    return visible_fraction(frame, ego, name, road, settings) < settings.hidden_fraction


def visible_fraction(frame: Frame, ego: str, name: str, road: Road, settings: SensorSettings) -> float:
    """Return how much of a vehicle is to be seen from another, in [0, 1]; 0 if it is not there."""
    if name not in frame.vehicle_id or ego not in frame.vehicle_id:
        return 0.0
    seen_from = replace(frame, ego=row_of(frame, ego))
    pose = seen_from.ego_pose
    sight = sight_to(frame.lon_m, frame.lat_m, road, pose, road.axis_of(frame.heading_rad))
    in_range = in_reach(settings, sight.distance, sight.off_axis)
    fraction, _, _ = visibility_of(seen_from, road, pose, in_range, settings.range_m)
    return float(fraction[row_of(frame, name)])
