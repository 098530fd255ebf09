"""Settings of a sensor.

One noise model serves all profiles. The measured centre of a vehicle is off by the error of fitting a box to it
(longitudinal and lateral), by an error along the line of sight and by an error of the bearing; a partly hidden vehicle
multiplies them all. A share of their variance drifts, the rest is new in each scan. What fails in runs (misses, split
and merged boxes) is a two-state chain for each vehicle. The figures that begin with ``nominal_`` are the data sheet:
what a tracker is told, rounded, and left as they are where the true figures are changed.
"""

from typing import Annotated, Self

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
    """Range: objects whose centre is further away are not detected."""
    field_of_view_deg: Annotated[float, Field(gt=0.0, le=360.0)] = 360.0
    """Angle of view, centred on the ego's heading."""
    detection_probability: Probability = 0.95
    """Probability of detecting a close vehicle in plain view, with single misses and runs of misses counted
    together."""
    view_exponent: Probability = 1.0
    """Exponent of the visible fraction in the detection probability of partly hidden vehicles; 0: like vehicles in
    plain view.
    """
    missed_far_share: Share = 0.0
    """Share of detections lost at the maximum range; it grows with the square of the distance."""
    missed_in_runs: Probability = 0.0
    """Share of the misses that come in runs; the others are independent from scan to scan."""
    missed_run_s: Positive = 0.3
    """Mean length of a run of misses of a vehicle in plain view."""
    missed_run_hidden_s: Positive = 0.6
    """Mean length of such a run for a vehicle that is almost hidden; linear in between."""
    burst_share: Share = 0.0
    """Share of a vehicle's time in bursts of misses that do not depend on visibility or range."""
    burst_s: Positive = 0.8
    """Mean length of such a burst."""
    detectability_share: Probability = 0.0
    """Share of vehicles that are hard to detect. Each has a constant factor on its detection probability."""
    detectability_least: Probability = 0.3
    """Smallest such factor; factors follow a beta distribution between it and 1."""
    detectability_mean: Probability = 0.65
    """Mean of the factors of vehicles that are hard to detect."""
    detectability_spread: Probability = 0.2
    """Standard deviation of these factors."""
    detectability_narrow: Probability = 1.0
    """Additional factor for vehicles narrower than 1.2 m, e.g. motorcycles."""
    full_view_fraction: Annotated[float, Field(gt=0.0, le=1.0)] = 0.7
    """Visible fraction from which a vehicle is in plain view; below it, detection falls and noise grows."""
    hidden_fraction: Probability = 0.15
    """Visible fraction below which a vehicle is hidden and never detected."""
    clutter_per_scan: Annotated[float, Field(ge=0.0, le=1000.0)] = 1.0
    """Expected number of single-scan false detections per scan, uniform over the road in view."""
    persistent_clutter: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    """Expected number of persistent false objects around the ego."""
    persistent_clutter_s: Positive = 3.0
    """Their mean lifetime."""
    persistent_clutter_probability: Probability = 0.6
    """Probability that each of them is detected in a scan."""
    persistent_clutter_moving: Probability = 0.3
    """Share of them that moves along a lane with the traffic, like reflections; the others do not move."""
    persistent_clutter_occluded: bool = False
    """Whether vehicles hide persistent false objects, mirror images and posts from the sensor."""
    mirrored_clutter: Annotated[float, Field(ge=0.0, le=1000.0, json_schema_extra={"unit": "objects"})] = 0.0
    """Expected number of false objects that mirror a real vehicle within range at a constant offset."""
    mirrored_clutter_s: Positive = 3.0
    """Their mean lifetime."""
    mirrored_clutter_probability: Probability = 0.6
    """Probability that each of them is detected in a scan."""
    posts_per_km: Annotated[float, Field(ge=0.0, le=1000.0, json_schema_extra={"unit": "1/km"})] = 0.0
    """Expected number of posts and signs per kilometre of lane that the detector permanently reports as vehicles."""
    posts_probability: Probability = 0.9
    """Probability that each of them is detected in a scan."""
    std_lon_m: Positive = 0.3
    """Standard deviation of the box's longitudinal position error, vehicle in plain view."""
    std_lat_m: Positive = 0.2
    """Standard deviation of the box's lateral position error."""
    std_range_m: NotNegative = 0.03
    """Standard deviation along the line of sight, constant part."""
    std_range_share: NotNegative = 0.0
    """Standard deviation along the line of sight, per metre of distance."""
    std_bearing_deg: Annotated[float, Field(ge=0.0, le=45.0)] = 0.1
    """Standard deviation of the bearing error."""
    hidden_noise_factor: Annotated[float, Field(ge=1.0, le=1e4)] = 3.0
    """Factor on all position errors of an almost hidden vehicle; it falls linearly to 1 in plain view."""
    bias_share: Probability = 0.0
    """Share of the position and size error variance that drifts, per vehicle; the rest is independent in each scan.
    """
    bias_time_s: Positive = 1.0
    """Time constant of that drift (Ornstein-Uhlenbeck)."""
    centre_shift_share: Probability = 0.0
    """Shift of a partly hidden vehicle's box towards its visible part, as a share of the hidden part."""
    split_share: Share = 0.0
    """Share of time in which a long vehicle is detected as two boxes."""
    split_s: Positive = 0.5
    """Mean duration of such an interval."""
    split_length_m: NotNegative = 8.0
    """Length above which a vehicle is long; 0: this applies to vehicles of any length."""
    merged_share: Share = 0.0
    """Share of time in which two vehicles close together are detected as one box."""
    merged_s: Positive = 0.4
    """Mean duration of such an interval."""
    merged_gap_m: Positive = 1.5
    """Largest gap between two vehicles that are close together."""
    latency_s: Annotated[float, Field(ge=0.0, le=10.0)] = 0.0
    """Age of the detections in a scan."""
    std_length_m: Positive | None = 0.45
    """Standard deviation of the measured length, vehicle in plain view; see ``std_width_m``."""
    std_width_m: Positive | None = 0.18
    """Standard deviation of the measured width; the sensor measures sizes if both are set."""
    std_range_rate_mps: Positive | None = None
    """Standard deviation of the measured range rate; not set if the sensor does not measure it."""
    score_separation: NotNegative = 0.0
    """Distance of the scores of true and false detections in standard deviations of their logarithmic odds, which are
    normal; the odds are right, as of a calibrated detector. 2.2 fits PointRCNN on KITTI; 0: no scores.
    """
    class_accuracy: Probability = 0.0
    """Probability that the class of a detection is right; the others are equally likely. It is also in the data sheet.
    0: no classes.
    """
    reported_factor: Positive = 1.0
    """Factor on the reported standard deviation in plain view, relative to the true one."""
    reported_spread: Probability = 0.25
    """Standard deviation of the logarithm of the reported deviation across detections; another half of it per
    quantity."""
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
    def _hidden_lies_below_full_view(self) -> Self:
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
