"""Shared by trackers where positions are in the plane and vehicles may have any heading.

They filter x and y alike. Nothing is known of a new track's direction, so its velocity is zero on the average; a
measured speed is one along the vehicle's own heading, which they don't know, and is left out.
"""

from dataclasses import replace

import numpy as np

from harness.trackers.protocol import TrackerSetting
from mmpf.scan import Scan
from mmpf.tracks import Tracks

_SLOW_MPS = 0.5


def is_in_plane(setting: TrackerSetting) -> bool:
    """Return whether the road frame is the plane."""
    return setting.road.has_headings


def without_directions(scan: Scan) -> Scan:
    """Return a scan of which nothing suggests that vehicles move along x."""
    unknown = np.full(len(scan.detections), np.nan)
    detections = replace(scan.detections, speed_mps=unknown, std_speed_mps=unknown)
    return replace(scan, detections=detections, ego=replace(scan.ego, speed_mps=0.0))


def along_their_motion(tracks: Tracks) -> Tracks:
    """Return tracks whose speeds and accelerations are along their motion, taken from those along x and y.

    Both coordinates are filtered alike, so that a speed is as uncertain in one direction as in any other.
    """
    speed = np.hypot(tracks.speed_mps, tracks.lat_speed_mps)
    cosine = np.divide(tracks.speed_mps, speed, out=np.zeros(len(tracks)), where=speed > _SLOW_MPS)
    return replace(tracks, speed_mps=speed, lat_speed_mps=np.zeros(len(tracks)), accel_mps2=tracks.accel_mps2 * cosine)
