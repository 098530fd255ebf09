"""Settings of Stone Soup's trackers."""

from typing import Literal

from harness.trackers.stonesoup.stitching import StitchingOptions
from harness.trackers.track_options import RivalOptions, TrackOptions
from mmpf.options.base import Positive, Probability


class StoneSoupOptions(RivalOptions):
    """Settings of a tracker whose tracks end when they are lost."""

    largest_std_lon_m: Positive = 5.0
    """A track with a wider spread ends."""


class ImmortalOptions(TrackOptions):
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
