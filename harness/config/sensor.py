"""What a sensor can do, in figures.

One noise model serves all profiles. The measured centre of a vehicle is off by the error of fitting a box to it
(longitudinal and lateral), by an error along the line of sight and by an error of the bearing; a partly hidden vehicle
multiplies them all. A share of their variance drifts, the rest is new in each scan. What fails in runs (misses, split
and merged boxes) is a two-state chain for each vehicle. The figures that begin with ``nominal_`` are the data sheet:
what a tracker is told, rounded, and left as they are where the true figures are changed.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field, model_validator

from mmpf.options.base import WithoutTruthValues

Positive = Annotated[float, Field(ge=1e-6, le=1e7)]
NotNegative = Annotated[float, Field(ge=0.0, le=1e7)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]
Share = Annotated[float, Field(ge=0.0, le=0.9)]


class SensorSettings(WithoutTruthValues):
    """All figures of one sensor."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    range_m: Positive = 100.0
    """Nothing whose centre is further away is detected."""
    field_of_view_deg: Annotated[float, Field(gt=0.0, le=360.0)] = 360.0
    """Angle of view, centred on the ego's heading."""
    detection_probability: Probability = 0.95
    """Probability of detecting a vehicle in plain view close by, single misses and runs of them together."""
    view_exponent: Probability = 1.0
    """Power with which detection falls with the visible fraction below plain view; 0: whoever is not hidden is seen as
    one in plain view is.
    """
    missed_far_share: Share = 0.0
    """Share of detections that is lost at the edge of the range; it grows with the square of the distance."""
    missed_in_runs: Probability = 0.0
    """Share of the misses that comes in runs; the rest is independent from scan to scan."""
    missed_run_s: Positive = 0.3
    """Mean length of a run of misses of a vehicle in plain view."""
    missed_run_hidden_s: Positive = 0.6
    """Mean length of such a run at the edge of being hidden; linear in between."""
    burst_share: Share = 0.0
    """Share of a vehicle's time in bursts of misses that have nothing to do with visibility or range."""
    burst_s: Positive = 0.8
    """Mean length of such a burst."""
    detectability_share: Probability = 0.0
    """Share of vehicles that are hard to detect: each keeps one factor on its detection probability all along."""
    detectability_least: Probability = 0.3
    """Smallest such factor; between it and one the factor is drawn from a beta distribution."""
    detectability_mean: Probability = 0.65
    """Mean of the factors of vehicles that are hard to detect."""
    detectability_spread: Probability = 0.2
    """Standard deviation of these factors."""
    detectability_narrow: Probability = 1.0
    """One more factor for narrow vehicles, which motorcycles are."""
    detectability_narrow_m: Positive = 1.2
    """Width below which a vehicle is narrow."""
    full_view_fraction: Annotated[float, Field(gt=0.0, le=1.0)] = 0.7
    """Seen to this fraction or more a vehicle is in plain view; below it detection falls and noise grows."""
    hidden_fraction: Probability = 0.15
    """A vehicle seen to less than this fraction is hidden and never detected."""
    clutter_per_scan: Annotated[float, Field(ge=0.0, le=1000.0)] = 1.0
    """Expected number of false detections a scan that flash up once, spread evenly over the road in view."""
    persistent_clutter: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    """Expected number of false objects around the ego that stay for a while."""
    persistent_clutter_s: Positive = 3.0
    """Their mean life."""
    persistent_clutter_probability: Probability = 0.6
    """Probability with which each of them is detected in a scan."""
    persistent_clutter_moving: Probability = 0.3
    """Share of them that moves along a lane with the traffic, as reflections do; the rest is fixed to the road."""
    persistent_clutter_occluded: bool = False
    """Whether false objects in the shadow of a vehicle are not detected: those that stay, mirrored ones and posts."""
    mirrored_clutter: Annotated[float, Field(ge=0.0, le=1000.0, json_schema_extra={"unit": "objects"})] = 0.0
    """Expected number of false objects that mirror a real vehicle within range: they keep their distance to it."""
    mirrored_clutter_s: Positive = 3.0
    """Their mean life."""
    mirrored_clutter_probability: Probability = 0.6
    """Probability with which each of them is detected in a scan."""
    posts_per_km: Annotated[float, Field(ge=0.0, le=1000.0, json_schema_extra={"unit": "1/km"})] = 0.0
    """Expected number of posts and signs per kilometre of lane that the detector takes for vehicles all along."""
    posts_probability: Probability = 0.9
    """Probability with which each of them is detected in a scan."""
    std_lon_m: Positive = 0.3
    """Longitudinal error of the box fitted to a vehicle in plain view."""
    std_lat_m: Positive = 0.2
    """Lateral error of that box."""
    std_range_m: NotNegative = 0.03
    """Error along the line of sight at any distance."""
    std_range_share: NotNegative = 0.0
    """Error along the line of sight in proportion to the distance."""
    std_bearing_deg: NotNegative = 0.1
    """Error of the bearing."""
    hidden_noise_factor: Annotated[float, Field(ge=1.0, le=1e4)] = 3.0
    """Factor on all position errors at the edge of being hidden; it falls linearly to one at plain view."""
    bias_share: Probability = 0.0
    """Share of the variance of position and size errors that drifts, vehicle by vehicle; the rest is new in each
    scan.
    """
    bias_time_s: Positive = 1.0
    """Time constant with which that share drifts (Ornstein-Uhlenbeck)."""
    centre_shift_share: Probability = 0.0
    """Share of the hidden part of a partly hidden vehicle by which its box recedes, towards what is seen of it."""
    split_share: Share = 0.0
    """Share of time in which a long vehicle is seen as two boxes."""
    split_s: Positive = 0.5
    """Mean length of such a time."""
    split_length_m: NotNegative = 8.0
    """Length from which a vehicle is long; 0: vehicles of any length are seen as two boxes."""
    merged_share: Share = 0.0
    """Share of time in which two vehicles close together are seen as one box."""
    merged_s: Positive = 0.4
    """Mean length of such a time."""
    merged_gap_m: Positive = 1.5
    """Gap between two bodies up to which they are close together."""
    latency_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """Age of the detections that a scan hands out."""
    std_length_m: Positive | None = 0.45
    """Error of the length of the box fitted to a vehicle in plain view; see ``std_width_m``."""
    std_width_m: Positive | None = 0.18
    """Error of its width; the sensor measures sizes if both are given."""
    std_range_rate_mps: Positive | None = None
    """Error of the measured range rate; none where the sensor does not measure it."""
    speed_obliquity_deg: Annotated[float, Field(gt=0.0, lt=90.0)] = 60.0
    """Range rate gives a speed where the line of sight is within this angle of the road."""
    road_width_m: Positive = 18.3
    """Width of road that a tracker assumes clutter to spread over."""
    reported_factor: Positive = 1.0
    """Factor on the deviation in plain view that detections report of themselves."""
    reported_spread: Probability = 0.25
    """Deviation of the logarithm of what they report from one detection to the next; half as much again by quantity."""
    reported_view: Probability = 0.25
    """Power of the true growth of the noise with hiddenness with which it shows in what they report."""
    nominal_detection_probability: Probability = 0.95
    """Data sheet: probability of detecting a vehicle in plain view."""
    nominal_clutter_per_scan: Annotated[float, Field(ge=0.0, le=1000.0)] = 1.0
    """Data sheet: expected number of false detections a scan, of all kinds."""
    nominal_full_view_fraction: Annotated[float, Field(gt=0.0, le=1.0)] = 0.7
    """Data sheet: visible fraction from which a vehicle is in plain view."""
    nominal_hidden_fraction: Probability = 0.15
    """Data sheet: visible fraction below which a vehicle is hidden."""
    nominal_bias_share: Probability = 0.0
    """Data sheet: share of the noise's variance that drifts."""
    nominal_bias_time_s: NotNegative = 0.0
    """Data sheet: time constant of that share."""

    @model_validator(mode="after")
    def _hidden_lies_below_full_view(self) -> SensorSettings:
        if self.hidden_fraction >= self.full_view_fraction:
            raise ValueError("hidden_fraction must be below full_view_fraction")
        if self.nominal_hidden_fraction >= self.nominal_full_view_fraction:
            raise ValueError("nominal_hidden_fraction must be below nominal_full_view_fraction")
        if self.detectability_share > 0.0 and not self.detectability_least < self.detectability_mean < 1.0:
            raise ValueError("detectability_mean must lie between detectability_least and 1")
        most = (self.detectability_mean - self.detectability_least) * (1.0 - self.detectability_mean)
        if self.detectability_share > 0.0 and not 0.0 < self.detectability_spread**2 < most:
            raise ValueError(f"detectability_spread must lie between 0 and {most**0.5:.3g} with this least and mean")
        return self
