"""Settings that the rivals share."""

from __future__ import annotations

from harness.trackers.track_options import TrackOptions
from mmpf.options.base import Positive


class RivalOptions(TrackOptions):
    """Settings of a tracker whose confirmed tracks end when they are lost."""

    longest_unseen_s: Positive = 5.0
    """A confirmed track without detections for longer ends."""
