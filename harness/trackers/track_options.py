"""Settings that all Kalman trackers share: motion, birth and reporting of tracks."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from harness.trackers.doubtful import DoubtfulOptions
from mmpf.options.base import Positive, Settings, in_unit


class TrackOptions(Settings):
    """Settings of a tracker of Kalman filters."""

    lon_noise: Annotated[Positive, in_unit("m²/s³")] = 1.0
    """Power spectral density of the longitudinal acceleration."""
    lat_noise: Annotated[Positive, in_unit("m²/s³")] = 0.1
    """Power spectral density of the lateral acceleration."""
    noise_factor: Annotated[Positive, in_unit("reported deviation")] = 1.0
    """Standard deviation of the measurement noise relative to the reported one; above 1 where errors are correlated in
    time.
    """
    gate_std: Positive = 3.9
    """A detection counts for a track within this many standard deviations."""
    confirm_detections: Annotated[int, Field(ge=1)] = 3
    """Detections before a track is confirmed."""
    held_unseen_s: Positive = 0.35
    """An unconfirmed track without detections for longer ends."""
    birth_speed_std_mps: Positive = 10.0
    """Spread of a new track's speed around the ego's, where speed is not measured."""
    birth_lat_speed_std_mps: Positive = 1.0
    """Spread of a new track's lateral speed."""
    hidden_after_s: Positive = 0.5
    """A track without detections for longer is reported as hidden; only pictures use this."""
    doubtful: DoubtfulOptions = DoubtfulOptions()
    """When a track that stands amid moving traffic is reported as tentative only."""
