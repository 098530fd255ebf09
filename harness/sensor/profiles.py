"""What a sensor can do, in figures: the settings and the named profiles.

One noise model serves all profiles. The measured centre of a vehicle is off by the error of fitting a box to it
(longitudinal and lateral), by an error along the line of sight and by an error of the bearing; a partly hidden vehicle
multiplies them all.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from harness.errors import InputError
from mmpf.registry import Registry, UnknownNameError

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
Probability = Annotated[float, Field(ge=0.0, le=1.0)]


class SensorSettings(BaseModel):
    """All figures of one sensor."""

    model_config = ConfigDict(frozen=True, extra="forbid", use_attribute_docstrings=True)

    range_m: Positive = 100.0
    """Nothing whose centre is further away is detected."""
    field_of_view_deg: Annotated[float, Field(gt=0.0, le=360.0)] = 360.0
    """Angle of view, centred on the ego's heading."""
    detection_probability: Probability = 0.95
    """Probability of detecting a vehicle in plain view."""
    full_view_fraction: Annotated[float, Field(gt=0.0, le=1.0)] = 0.7
    """Seen to this fraction or more a vehicle is in plain view; below it detection falls in proportion."""
    hidden_fraction: Probability = 0.15
    """A vehicle seen to less than this fraction is hidden and never detected."""
    clutter_per_scan: Annotated[float, Field(ge=0.0, le=1000.0)] = 1.0
    """Expected number of false detections a scan, spread evenly over the road in view."""
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

    @model_validator(mode="after")
    def _hidden_lies_below_full_view(self) -> SensorSettings:
        if self.hidden_fraction >= self.full_view_fraction:
            raise ValueError("hidden_fraction must be below full_view_fraction")
        return self


sensor_profiles: Registry[Callable[[], SensorSettings]] = Registry("sensor")


def sensor_settings(profile: str, overrides: Mapping[str, object]) -> SensorSettings:
    """Return a profile's settings with some fields replaced.

    Args:
        profile: Name of a profile.
        overrides: New values by field name; numbers may be given as text.

    Raises:
        InputError: There is no such profile or field, or a value is out of bounds.
    """
    try:
        settings = sensor_profiles[profile]()
    except UnknownNameError as error:
        raise InputError(f"`sensor`: {error}") from None
    try:
        return SensorSettings.model_validate({**settings.model_dump(), **overrides})
    except ValidationError as error:
        raise InputError(_first_complaint(error)) from None


def _first_complaint(error: ValidationError) -> str:
    complaint = error.errors(include_url=False)[0]
    name = ".".join(["sensor", *(str(part) for part in complaint["loc"])])
    if complaint["type"] == "extra_forbidden":
        return f"{name}: no such setting; known are: {', '.join(sorted(SensorSettings.model_fields))}"
    given = complaint["input"] if complaint["loc"] else None
    message = complaint["msg"].removeprefix("Value error, ")
    return f"{name}: {message[0].lower()}{message[1:]}" + ("" if given is None else f" (given: {given!r})")


@sensor_profiles.register("lidar")
def lidar() -> SensorSettings:
    """Return a roof lidar with a box detector: position only.

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
    the detection probability and the clutter are assumptions.
    """
    return SensorSettings(
        detection_probability=0.9,
        clutter_per_scan=2.0,
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
    apparent size. The bearing error is two pixels of such a camera (0.08 degrees each). The rest are assumptions.
    """
    return SensorSettings(
        detection_probability=0.9,
        clutter_per_scan=0.5,
        std_range_m=0.0,
        std_range_share=0.05,
        std_bearing_deg=0.15,
        std_length_m=0.7,
        std_width_m=0.25,
    )
