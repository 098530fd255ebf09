"""Settings that the rivals share, and their conversion to the plane."""

from __future__ import annotations

from typing import TypeVar

from harness.trackers.plane import is_in_plane
from harness.trackers.protocol import TrackerSetting
from harness.trackers.track_options import TrackOptions
from mmpf.options.base import Positive


class RivalOptions(TrackOptions):
    """Settings of a tracker whose confirmed tracks end when they are lost."""

    longest_unseen_s: Positive = 5.0
    """A confirmed track without detections for longer ends."""


_Options = TypeVar("_Options", bound=RivalOptions)


def in_frame(options: _Options, setting: TrackerSetting) -> _Options:
    """Return the options; in the plane y is filtered as x, since roads lead anywhere."""
    if not is_in_plane(setting):
        return options
    alike = {"lat_noise": options.lon_noise, "birth_lat_speed_std_mps": options.birth_speed_std_mps}
    return options.model_copy(update=alike)
