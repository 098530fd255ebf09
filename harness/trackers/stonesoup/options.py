"""Settings of Stone Soup's trackers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import Field

from harness.trackers.stonesoup.stitching import StitchingOptions
from mmpf.options import Positive, Probability, Settings


class StoneSoupOptions(Settings):
    """Settings that all of Stone Soup's trackers share.

    Attributes:
        motion: Nearly constant velocity or nearly constant acceleration, longitudinally.
        lon_noise: Power spectral density of the longitudinal acceleration (cv, m^2/s^3) or jerk (ca, m^2/s^5).
        lat_noise: Power spectral density of the lateral acceleration, m^2/s^3.
        gate_std: A detection counts for a track within this many standard deviations.
        confirm_detections: Detections before a track is confirmed.
        held_unseen_s: An unconfirmed track ends when unseen for longer.
        longest_unseen_s: A confirmed one.
        largest_std_lon_m: A track spread wider than this ends.
        range_margin_m: A track this far beyond the sensor's range ends.
        birth_speed_std_mps: Spread of a new track's speed around the ego's, where speed is not measured.
        birth_lat_speed_std_mps: Spread of a new track's lateral speed.
        birth_accel_std_mps2: Spread of a new track's acceleration (ca).
        hidden_after_s: Unseen for longer, a track is reported as hidden, which is for pictures alone.
        coarse_gate: Whether detections far outside a track's gate are left out before Stone Soup computes distances
            to them. The Kalman trackers' tracks stay the same, in about half the time; off, they run as Stone Soup
            ships them.
    """

    motion: Literal["cv", "ca"] = "cv"
    lon_noise: Positive = 1.0
    lat_noise: Positive = 0.1
    gate_std: Positive = 3.9
    confirm_detections: Annotated[int, Field(ge=1)] = 3
    held_unseen_s: Positive = 0.35
    longest_unseen_s: Positive = 5.0
    largest_std_lon_m: Positive = 5.0
    range_margin_m: Annotated[float, Field(ge=0.0)] = 4.0
    birth_speed_std_mps: Positive = 10.0
    birth_lat_speed_std_mps: Positive = 1.0
    birth_accel_std_mps2: Positive = 1.0
    hidden_after_s: Positive = 0.5
    coarse_gate: bool = False

    @property
    def layout(self) -> StateLayout:
        """Where the state vector of the motion model holds what."""
        return _LAYOUTS[self.motion]


class JpdaOptions(StoneSoupOptions):
    """Settings of the JPDA tracker.

    Attributes:
        detection_probability: Used in association; None takes the sensor's. Vehicles that others hide are missed
            far more often than the data sheet says, and JPDA knows of no shadows.
    """

    detection_probability: Probability | None = None


class StitchedJpdaOptions(JpdaOptions):
    """Settings of the JPDA tracker with identity stitching.

    Attributes:
        stitching: When a new track takes a lost one's identity.
    """

    stitching: StitchingOptions = StitchingOptions()


class ParticleOptions(StoneSoupOptions):
    """Settings of the particle tracker.

    Attributes:
        particles: Particles per track.
    """

    particles: Annotated[int, Field(ge=10)] = 300


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
