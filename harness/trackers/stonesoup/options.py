"""Settings of Stone Soup's trackers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from harness.trackers.stonesoup.stitching import StitchingOptions
from mmpf.settings import Positive, Probability, Settings, in_unit


class StoneSoupOptions(Settings):
    """Settings that all of Stone Soup's trackers share."""

    motion: Literal["cv", "ca"] = "cv"
    """Nearly constant velocity or nearly constant acceleration, longitudinally."""
    lon_noise: Annotated[Positive, in_unit("m²/s³ (cv), m²/s⁵ (ca)")] = 1.0
    """Power spectral density of the longitudinal acceleration (cv) or jerk (ca)."""
    lat_noise: Annotated[Positive, in_unit("m²/s³")] = 0.1
    """Power spectral density of the lateral acceleration."""
    gate_std: Positive = 3.9
    """A detection counts for a track within this many standard deviations."""
    confirm_detections: Annotated[int, Field(ge=1)] = 3
    """Detections before a track is confirmed."""
    held_unseen_s: Positive = 0.35
    """An unconfirmed track ends when unseen for longer."""
    longest_unseen_s: Positive = 5.0
    """A confirmed track ends when unseen for longer."""
    largest_std_lon_m: Positive = 5.0
    """A track spread wider than this ends."""
    range_margin_m: Annotated[float, Field(ge=0.0)] = 4.0
    """A track this far beyond the sensor's range ends."""
    birth_speed_std_mps: Positive = 10.0
    """Spread of a new track's speed around the ego's, where speed is not measured."""
    birth_lat_speed_std_mps: Positive = 1.0
    """Spread of a new track's lateral speed."""
    birth_accel_std_mps2: Positive = 1.0
    """Spread of a new track's acceleration (ca)."""
    hidden_after_s: Positive = 0.5
    """Unseen for longer, a track is reported as hidden, which is for pictures alone."""
    coarse_gate: bool = False
    """Whether detections far outside a track's gate are left out before Stone Soup computes distances to them. The
    Kalman trackers' tracks stay the same, in about half the time; off, they run as Stone Soup ships them.
    """

    @property
    def layout(self) -> StateLayout:
        """Where the state vector of the motion model holds what."""
        return _LAYOUTS[self.motion]


class JpdaOptions(StoneSoupOptions):
    """Settings of the JPDA tracker."""

    detection_probability: Probability | None = None
    """Detection probability used in association; None takes the sensor's. Vehicles that others hide are missed
    far more often than the data sheet says, and JPDA knows of no shadows.
    """


class StitchedJpdaOptions(JpdaOptions):
    """Settings of the JPDA tracker with identity stitching."""

    stitching: StitchingOptions = StitchingOptions()
    """When a new track takes a lost one's identity."""


class ParticleOptions(StoneSoupOptions):
    """Settings of the particle tracker."""

    particles: Annotated[int, Field(ge=10)] = 300
    """Particles per track."""


@dataclass(frozen=True)
class StateLayout:
    """Rows of the state vector.

    Attributes:
        lon: Longitudinal position.
        speed: Longitudinal speed.
        accel: Longitudinal acceleration; None without.
        lat: Lateral position.
        lat_speed: Lateral speed.
        size: Number of rows.
    """

    lon: int
    speed: int
    accel: int | None
    lat: int
    lat_speed: int
    size: int


_LAYOUTS = {"cv": StateLayout(0, 1, None, 2, 3, 4), "ca": StateLayout(0, 1, 2, 3, 4, 5)}
