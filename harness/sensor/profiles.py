"""The named sensor profiles: simulated sensors, and data sheets of recorded detectors."""

from collections.abc import Callable, Mapping

from pydantic import ValidationError

from harness.common.error_text import first_problem, nearest, what_it_raised
from harness.common.errors import InputError
from harness.common.named import check_made
from harness.config.sensor import SensorSettings
from mmpf.registry import Registry, UnknownNameError

# TOML can not say none.
MAY_BE_NONE = ("std_length_m", "std_width_m", "std_range_rate_mps")
sensor_profiles: Registry[Callable[[], SensorSettings]] = Registry(
    "sensor",
    "harness.sensors",
    fault=lambda made: "" if isinstance(made, SensorSettings) else "not SensorSettings",
)


def sensor_settings(profile: str, overrides: Mapping[str, object]) -> SensorSettings:
    """Return a profile's settings with some fields replaced.

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
    return profile in sensor_profiles.own


def has_all_figures(profile: str, overrides: Mapping[str, object]) -> bool:
    """Return whether a profile from outside is written out in full, so that nothing need be imported for it."""
    return not is_built_in(profile) and set(SensorSettings.model_fields) - set(MAY_BE_NONE) <= set(overrides)


def _of_profile(profile: str) -> SensorSettings:
    try:
        settings = sensor_profiles[profile]()
    except UnknownNameError as error:
        raise InputError(f"`sensor`: {error}") from None
    except Exception as error:
        if is_built_in(profile):
            raise
        raise InputError(
            f"`sensor` {profile}: creating it failed ({what_it_raised(error)}); fix the profile"
        ) from error
    check_made(sensor_profiles, "sensor", profile, settings)
    return settings


def _first_complaint(error: ValidationError) -> str:
    key, message, given, unknown = first_problem(error)
    name = f"sensor.{key}" if key else "sensor"
    if unknown:
        return f"{name}: no such setting{nearest(key, list(SensorSettings.model_fields))}"
    return f"{name}: {message}" + (f" (given: {given!r})" if key and given is not None else "")


@sensor_profiles.register("ideal")
def ideal() -> SensorSettings:
    """Return the detector of the paper: every vehicle that is not hidden is detected; there are no false detections.

    A vehicle of which less than 0.16 is seen counts as completely occluded (Li, Zhan & Tomizuka 2018 do not say where
    they draw the line; 0.16 is taken). There are no misses, no clutter, no drift; the position errors are those of
    ``lidar-independent``.
    """
    return SensorSettings(
        detection_probability=1.0, view_exponent=0.0, hidden_fraction=0.16, clutter_per_scan=0.0,
        nominal_detection_probability=0.99, nominal_clutter_per_scan=0.01, nominal_full_view_fraction=0.2,
        nominal_hidden_fraction=0.15,
    )  # fmt: skip


@sensor_profiles.register("lidar")
def lidar() -> SensorSettings:
    """Return a roof lidar with a realistic box detector: position and size.

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
        detection_probability=0.97, view_exponent=0.35, missed_far_share=0.08, missed_in_runs=0.6, missed_run_s=0.4,
        missed_run_hidden_s=0.6, clutter_per_scan=1.3, persistent_clutter=5.0, persistent_clutter_s=4.0, std_lon_m=0.25,
        std_lat_m=0.15, std_bearing_deg=0.05, hidden_noise_factor=2.0, bias_share=0.5, bias_time_s=1.0,
        centre_shift_share=0.2, split_share=0.05, merged_share=0.02, reported_factor=1.2, reported_spread=0.3,
        nominal_detection_probability=0.9, nominal_clutter_per_scan=4.0, nominal_bias_share=0.5,
        nominal_bias_time_s=1.0,
    )  # fmt: skip


@sensor_profiles.register("lidar-real")
def lidar_real() -> SensorSettings:
    """Return a lidar fitted to real detections; docs/explanation/sensor.md describes the data and the fit.

    Detection by visible fraction and range, runs of misses, lives of false objects and errors of boxes are those of
    PointRCNN on ten sequences of KITTI tracking and of PointPillars on 32 of V2V4Real, which these networks were partly
    trained on; the tool of the fit exists at revision 108b5b1. How unlike vehicles are in plain view is fitted to what
    PointRCNN found of each labelled one (the fit exists at revision dc0231a); detection close by, 0.911
    on the average, is higher for most. That narrow vehicles are found less often is an assumption. How false objects
    move, how far boxes recede and how they are split and merged was not fitted: the first two are as in ``lidar``, and
    boxes stay whole.
    """
    return SensorSettings(
        detection_probability=0.938, detectability_share=1.0, detectability_least=0.0, detectability_mean=0.971,
        detectability_spread=0.0725, detectability_narrow=0.8, view_exponent=0.11, missed_far_share=0.9,
        full_view_fraction=0.598, hidden_fraction=0.02, missed_in_runs=0.724, missed_run_s=0.219,
        missed_run_hidden_s=3.3, burst_share=0.0618, burst_s=5.55, clutter_per_scan=0.613, persistent_clutter=4.52,
        persistent_clutter_s=0.6, persistent_clutter_probability=0.727, std_lon_m=0.182, std_lat_m=0.0996,
        std_bearing_deg=0.05, hidden_noise_factor=1.44, bias_share=0.65, bias_time_s=2.0, centre_shift_share=0.2,
        std_length_m=0.316, std_width_m=0.137, reported_factor=1.2, reported_spread=0.3,
        nominal_detection_probability=0.85, nominal_clutter_per_scan=4.0, nominal_full_view_fraction=0.6,
        nominal_hidden_fraction=0.05, nominal_bias_share=0.65, nominal_bias_time_s=2.0,
    )  # fmt: skip


@sensor_profiles.register("kitti-pointrcnn")
def kitti_pointrcnn() -> SensorSettings:
    """Return the data sheet of PointRCNN's car boxes on KITTI tracking; the recording contains the detections.

    Only reach, data sheet and the deviations that detections report of themselves count. They are set after the ten
    training sequences that are not in AB3DMOT's validation split, scores of 2 and more: robust deviations of 0.11 m
    along and 0.06 m across vehicles, which double at 50 m, 0.23 m and 0.07 m of sizes; 85 % of vehicles that nothing
    covers are found, and there are 0.6 boxes a frame on nothing that is labelled, some of them on vehicles too far
    away to be labelled. The network was trained on parts of these recordings.
    """
    return SensorSettings(
        range_m=80.0, field_of_view_deg=82.0, std_lon_m=0.12, std_lat_m=0.05, std_range_m=0.05, std_range_share=0.003,
        std_bearing_deg=0.1, std_length_m=0.24, std_width_m=0.08, nominal_detection_probability=0.87,
        nominal_clutter_per_scan=1.0, nominal_bias_share=0.5, nominal_bias_time_s=1.0,
    )  # fmt: skip


@sensor_profiles.register("av2-points")
def av2_points() -> SensorSettings:
    """Return a detector that finds every object with at least three points of Argoverse 2's real lidars.

    Who is seen is on record, nothing else fails: there are no misses and no false boxes. How far boxes are off is
    drawn, after what detectors do on KITTI and V2V4Real: 0.15 m along and 0.1 m across vehicles, sizes by 0.25 m and
    0.1 m.
    """
    return SensorSettings(
        range_m=150.0, std_lon_m=0.15, std_lat_m=0.1, std_length_m=0.25, std_width_m=0.1,
        nominal_detection_probability=0.95, nominal_clutter_per_scan=0.1,
    )  # fmt: skip


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
        detection_probability=0.9, view_exponent=0.5, missed_far_share=0.1, missed_in_runs=0.6, clutter_per_scan=2.0,
        persistent_clutter=5.0, persistent_clutter_moving=0.5, bias_share=0.4, bias_time_s=0.8, centre_shift_share=0.3,
        split_share=0.1, merged_share=0.1, merged_gap_m=2.0, reported_factor=1.2, nominal_detection_probability=0.85,
        nominal_clutter_per_scan=5.0, nominal_bias_share=0.5, nominal_bias_time_s=1.0, std_lon_m=0.5, std_lat_m=0.3,
        std_range_m=0.4, std_bearing_deg=0.5, std_length_m=None, std_width_m=None, std_range_rate_mps=0.1,
    )  # fmt: skip


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
        detection_probability=0.93, view_exponent=0.5, missed_far_share=0.3, missed_in_runs=0.8, clutter_per_scan=0.5,
        persistent_clutter=1.5, bias_share=0.7, bias_time_s=1.5, centre_shift_share=0.3, merged_share=0.05,
        reported_factor=1.2, nominal_detection_probability=0.85, nominal_clutter_per_scan=1.5, nominal_bias_share=0.7,
        nominal_bias_time_s=1.5, std_range_m=0.0, std_range_share=0.05, std_bearing_deg=0.15, std_length_m=0.7,
        std_width_m=0.25,
    )  # fmt: skip
