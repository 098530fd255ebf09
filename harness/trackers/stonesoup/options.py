"""Settings of Stone Soup's trackers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

from harness.trackers.stonesoup.stitching import StitchingOptions
from harness.trackers.track_options import TrackOptions
from mmpf.options.base import Positive, Probability, in_unit


class KalmanOptions(TrackOptions):
    """Settings that all of Stone Soup's trackers share."""

    motion: Literal["cv", "ca"] = "cv"
    """Nearly constant velocity or nearly constant acceleration, longitudinally."""
    lon_noise: Annotated[Positive, in_unit("m²/s³ (cv), m²/s⁵ (ca)")] = 1.0
    """Power spectral density of the longitudinal acceleration (cv) or jerk (ca)."""
    birth_accel_std_mps2: Positive = 1.0
    """Spread of a new track's acceleration (ca)."""
    coarse_gate: bool = False
    """Whether detections far outside a track's gate are left out before Stone Soup computes distances to them. The
    Kalman trackers' tracks do not change, and the time halves; if off, Stone Soup runs unmodified.
    """

    @property
    def layout(self) -> StateLayout:
        """Where the state vector of the motion model holds what."""
        return _LAYOUTS[self.motion]


class StoneSoupOptions(KalmanOptions):
    """Settings of a tracker whose tracks end when they are lost."""

    longest_unseen_s: Positive = 5.0
    """A confirmed track without detections for longer ends."""
    largest_std_lon_m: Positive = 5.0
    """A track with a wider spread ends."""


class ImmortalOptions(KalmanOptions):
    """Settings of the tracker whose confirmed tracks never end within range."""

    association: Literal["distance", "mahalanobis"] = "distance"
    """Distance used in association: in shares of the two gates, or in standard deviations. By the latter a track that
    has long been undetected is near to every detection.
    """
    gate_lon_m: Positive = 6.0
    """A detection counts for a confirmed track within this distance along the road."""
    gate_lat_m: Positive = 1.6
    """The same, across the road."""


class JpdaOptions(StoneSoupOptions):
    """Settings of the JPDA tracker."""

    detection_probability: Probability | None = None
    """Detection probability used in association; None takes the sensor's. Hidden vehicles are missed far more often
    than the data sheet says, and JPDA does not model shadows.
    """
    clutter_factor: Positive = 1.0
    """Clutter density used in association, relative to the data sheet's."""


class StitchedJpdaOptions(JpdaOptions):
    """Settings of the JPDA tracker with identity stitching."""

    stitching: StitchingOptions = StitchingOptions()
    """When a new track takes a lost one's identity."""


@dataclass(frozen=True)
class StateLayout:
    """Rows of the state vector, and how many there are; no row of the acceleration if it is None."""

    lon: int
    speed: int
    accel: int | None
    lat: int
    lat_speed: int
    size: int


_LAYOUTS = {"cv": StateLayout(0, 1, None, 2, 3, 4), "ca": StateLayout(0, 1, 2, 3, 4, 5)}
