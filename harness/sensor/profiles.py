"""What a sensor can do, in figures: the settings and the named profiles.

One noise model serves all profiles. The measured centre of a vehicle is off by the error of fitting a box to it
(longitudinal and lateral), by an error along the line of sight and by an error of the bearing; a partly hidden vehicle
multiplies them all. A share of their variance drifts, the rest is new in each scan. What fails in runs (misses, split
and merged boxes) is a two-state chain for each vehicle. The figures that begin with ``nominal_`` are the data sheet:
what a tracker is told, rounded, and left as they are where the true figures are changed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated

from pydantic import ConfigDict, Field, ValidationError, model_validator

from harness.errors import InputError
from harness.writing.problems import first_problem, what_it_raised
from mmpf.registry import Registry, UnknownNameError
from mmpf.settings import WithoutTruthValues

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
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
    hidden_noise_factor: Annotated[float, Field(ge=1.0, allow_inf_nan=False)] = 3.0
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
    split_length_m: Positive = 8.0
    """Length from which a vehicle is long."""
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
        return self


# TOML can not say none.
MAY_BE_NONE = ("std_length_m", "std_width_m", "std_range_rate_mps")
sensor_profiles: Registry[Callable[[], SensorSettings]] = Registry("sensor", "harness.sensors")


def sensor_settings(profile: str, overrides: Mapping[str, object]) -> SensorSettings:
    """Return a profile's settings with some fields replaced.

    Args:
        profile: Name of a profile.
        overrides: New values by field name; numbers may be given as text.

    Raises:
        InputError: There is no such profile or field, or a value is out of bounds.
    """
    figures = dict.fromkeys(MAY_BE_NONE) if has_all_figures(profile, overrides) else _of_profile(profile).model_dump()
    try:
        return SensorSettings.model_validate({**figures, **overrides})
    except ValidationError as error:
        raise InputError(_first_complaint(error)) from None


def is_built_in(profile: str) -> bool:
    """Return whether a profile is this package's, or was registered by this program."""
    return profile in sensor_profiles.in_order()


def has_all_figures(profile: str, overrides: Mapping[str, object]) -> bool:
    """Return whether a profile from outside is written out in full, so that nothing need be imported for it.

    Args:
        profile: Name of a profile.
        overrides: New values by field name; what may be none and is not named is none.
    """
    return not is_built_in(profile) and set(SensorSettings.model_fields) - set(MAY_BE_NONE) <= set(overrides)


def _of_profile(profile: str) -> SensorSettings:
    try:
        settings = sensor_profiles[profile]()
    except UnknownNameError as error:
        raise InputError(f"`sensor`: {error}") from None
    except Exception as error:
        if is_built_in(profile):
            raise
        raise InputError(f"`sensor` {profile}: it can't be made ({what_it_raised(error)}); mend it") from error
    if not isinstance(settings, SensorSettings):
        raise InputError(f"`sensor` {profile}: it returned {type(settings).__name__}, not SensorSettings")
    return settings


def _first_complaint(error: ValidationError) -> str:
    key, message, given, unknown = first_problem(error)
    name = f"sensor.{key}" if key else "sensor"
    if unknown:
        return f"{name}: no such setting; known are: {', '.join(sorted(SensorSettings.model_fields))}"
    return f"{name}: {message}" + (f" (given: {given!r})" if key and given is not None else "")


@sensor_profiles.register("ideal")
def ideal() -> SensorSettings:
    """Return the detector of the paper: whoever is not hidden is seen, and nothing else is.

    A vehicle of which less than 0.16 is seen counts as completely occluded (Li, Zhan & Tomizuka 2018 do not say where
    they draw the line; 0.16 is taken). There are no misses, no clutter, no drift; the position errors are those of
    ``lidar-independent``.
    """
    return SensorSettings(
        detection_probability=1.0,
        view_exponent=0.0,
        hidden_fraction=0.16,
        clutter_per_scan=0.0,
        nominal_detection_probability=0.99,
        nominal_clutter_per_scan=0.01,
        nominal_full_view_fraction=0.2,
        nominal_hidden_fraction=0.15,
    )


@sensor_profiles.register("lidar")
def lidar() -> SensorSettings:
    """Return a roof lidar with a box detector that fails as real ones do: position and size.

    Beside the noise of ``lidar-independent``, its failings are set after published detections that were counted against
    labels, which go on through occlusion: PointRCNN on the 21 sequences of KITTI tracking (76 % of 31 790 boxes found,
    36 gaps of 0.5 s and 14 of 1 s in 1000 vehicle-seconds, hidden vehicles among them) and PointPillars on V2V4Real
    (69 % found, 4.1 false boxes a frame, 41 and 21 gaps). Both networks were trained on parts of these recordings.
    Median errors of the centre were 0.06 to 0.17 m and 0.14 to 0.35 m. So there are about four false boxes a frame,
    most of them of objects that stay; misses come in runs of a few tenths of a second, longer and oftener for whom
    others partly hide; and errors drift. How long false objects live, the share that moves, how fast errors drift, by
    how much a partly hidden vehicle's box recedes, and how often boxes are split and merged are assumptions.
    """
    return SensorSettings(
        detection_probability=0.97,
        view_exponent=0.35,
        missed_far_share=0.08,
        missed_in_runs=0.6,
        missed_run_s=0.4,
        missed_run_hidden_s=0.6,
        clutter_per_scan=1.3,
        persistent_clutter=5.0,
        persistent_clutter_s=4.0,
        std_lon_m=0.25,
        std_lat_m=0.15,
        std_bearing_deg=0.05,
        hidden_noise_factor=2.0,
        bias_share=0.5,
        bias_time_s=1.0,
        centre_shift_share=0.2,
        split_share=0.05,
        merged_share=0.02,
        reported_factor=1.2,
        reported_spread=0.3,
        nominal_detection_probability=0.9,
        nominal_clutter_per_scan=4.0,
        nominal_bias_share=0.5,
        nominal_bias_time_s=1.0,
    )


@sensor_profiles.register("kitti-pointrcnn")
def kitti_pointrcnn() -> SensorSettings:
    """Return what is known of PointRCNN's car boxes on KITTI tracking, which a recording brings; nothing is drawn.

    Only reach, data sheet and the deviations that detections report of themselves count. They are set after the ten
    training sequences that are not in AB3DMOT's validation split, scores of 2 and more: robust deviations of 0.11 m
    along and 0.06 m across vehicles, which double at 50 m, 0.23 m and 0.07 m of sizes; 85 % of vehicles that nothing
    covers are found, and there are 0.6 boxes a frame on nothing that is labelled, some of them on vehicles too far
    away to be labelled. The network was trained on parts of these recordings.
    """
    return SensorSettings(
        range_m=80.0,
        field_of_view_deg=82.0,
        std_lon_m=0.12,
        std_lat_m=0.05,
        std_range_m=0.05,
        std_range_share=0.003,
        std_bearing_deg=0.1,
        std_length_m=0.24,
        std_width_m=0.08,
        nominal_detection_probability=0.87,
        nominal_clutter_per_scan=1.0,
        nominal_bias_share=0.5,
        nominal_bias_time_s=1.0,
    )


@sensor_profiles.register("av2-points")
def av2_points() -> SensorSettings:
    """Return a detector that finds whatever at least three points of Argoverse 2's real lidars fell on.

    Who is seen is on record, nothing else fails: there are no misses and no false boxes. How far boxes are off is
    drawn, after what detectors do on KITTI and V2V4Real: 0.15 m along and 0.1 m across vehicles, sizes by 0.25 m and
    0.1 m.
    """
    return SensorSettings(
        range_m=150.0,
        std_lon_m=0.15,
        std_lat_m=0.1,
        std_length_m=0.25,
        std_width_m=0.1,
        nominal_detection_probability=0.95,
        nominal_clutter_per_scan=0.1,
    )


@sensor_profiles.register("v2v4real-pointpillars")
def v2v4real_pointpillars() -> SensorSettings:
    """Return what is known of PointPillars' boxes on V2V4Real, one car's own, which a recording brings.

    Nothing is drawn: only reach, data sheet and the deviations that detections report of themselves count. They are set
    after the 32 training sequences of DMSTrack's files, scores of 0.2 and more: robust deviations of 0.21 m along and
    0.11 m across vehicles within 20 m, which double at 70 m, 0.40 m and 0.17 m of sizes; 65 % of what either of two
    cars saw is found, and there are 3.9 boxes a frame on nothing that is labelled. The network was trained on these
    sequences.
    """
    return SensorSettings(
        range_m=105.0,
        std_lon_m=0.2,
        std_lat_m=0.11,
        std_range_m=0.05,
        std_range_share=0.005,
        std_bearing_deg=0.15,
        std_length_m=0.4,
        std_width_m=0.17,
        nominal_detection_probability=0.7,
        nominal_clutter_per_scan=4.0,
        nominal_bias_share=0.5,
        nominal_bias_time_s=1.0,
    )


@sensor_profiles.register("lidar-independent")
def lidar_independent() -> SensorSettings:
    """Return a roof lidar whose misses, noise and clutter are independent from scan to scan.

    The position errors are of the order of the average translation error (centre distance) by which the nuScenes
    benchmark ranks lidar detectors (Caesar et al., CVPR 2020): a few tenths of a metre for cars, taken larger along
    the vehicle than across it because mostly one end is seen. Range error 3 cm and bearing error 0.1 degrees are usual
    for spinning automotive lidars. Length and width are off by about a tenth of a car's: the average scale error
    (one less the overlap of aligned boxes) of good detectors for cars on the same benchmark is 0.15. A false detection
    a scan and a detection probability of 0.95 are assumptions.
    """
    return SensorSettings()


@sensor_profiles.register("radar")
def radar() -> SensorSettings:
    """Return radars all round: position, and speed from the range rate.

    Range error 0.4 m, range-rate error 0.1 m/s and a bearing error between 0.1 degrees (far beam) and a degree and
    more (near beam) are usual data-sheet figures of 77 GHz long-range radars; half a degree is taken for all beams.
    The reflection wanders over the body (glint), so that the fitted centre is worse than a lidar's. How much worse,
    the detection probability, the clutter and how much of either comes in runs are assumptions: reflections that stay
    or move with the traffic are usual, and a target fades for some tenths of a second.
    """
    return SensorSettings(
        detection_probability=0.9,
        view_exponent=0.5,
        missed_far_share=0.1,
        missed_in_runs=0.6,
        clutter_per_scan=2.0,
        persistent_clutter=5.0,
        persistent_clutter_moving=0.5,
        bias_share=0.4,
        bias_time_s=0.8,
        centre_shift_share=0.3,
        split_share=0.1,
        merged_share=0.1,
        merged_gap_m=2.0,
        reported_factor=1.2,
        nominal_detection_probability=0.85,
        nominal_clutter_per_scan=5.0,
        nominal_bias_share=0.5,
        nominal_bias_time_s=1.0,
        std_lon_m=0.5,
        std_lat_m=0.3,
        std_range_m=0.4,
        std_bearing_deg=0.5,
        std_length_m=None,
        std_width_m=None,
        std_range_rate_mps=0.1,
    )


@sensor_profiles.register("camera")
def camera() -> SensorSettings:
    """Return cameras all round: bearing good, range poor.

    The range error of a single camera that uses the ground contact is range^2 / (focal length * height) for each pixel
    of error (Stein, Mano & Shashua, IEEE IV 2003): 5 % of the range at 44 m with 740 pixels and 1.2 m. It grows with
    the square of the range there; here in proportion to it, as a stand-in for detectors that also use the vehicle's
    apparent size. The bearing error is two pixels of such a camera (0.08 degrees each). The rest are assumptions: most
    of the range error drifts, since it comes of the vehicle's assumed size and the camera's pitch, and far vehicles are
    missed oftener than by a lidar.
    """
    return SensorSettings(
        detection_probability=0.93,
        view_exponent=0.5,
        missed_far_share=0.3,
        missed_in_runs=0.8,
        clutter_per_scan=0.5,
        persistent_clutter=1.5,
        bias_share=0.7,
        bias_time_s=1.5,
        centre_shift_share=0.3,
        merged_share=0.05,
        reported_factor=1.2,
        nominal_detection_probability=0.85,
        nominal_clutter_per_scan=1.5,
        nominal_bias_share=0.7,
        nominal_bias_time_s=1.5,
        std_range_m=0.0,
        std_range_share=0.05,
        std_bearing_deg=0.15,
        std_length_m=0.7,
        std_width_m=0.25,
    )
