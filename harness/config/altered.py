"""Settings that change detections after the sensor made them, for live and for recorded runs."""

from typing import Annotated, Self

from pydantic import BeforeValidator, ConfigDict, Field, model_validator

from harness.config.lists import numbers
from harness.config.sensor import NotNegative, Positive, Probability, SensorSettings, Share
from mmpf.options.base import WithoutTruthValues

Count = Annotated[float, Field(ge=0.0, le=1000.0, json_schema_extra={"unit": "objects"})]


def _times(value: object) -> object:
    """Return the times of a list with commas, as the command line gives it."""
    return numbers(value, "hide", "1,2,3,5") if isinstance(value, str) else value


# Figures of false detections that are the sensor's own unless they are set here.
FIGURES = (
    *("persistent_clutter_s", "persistent_clutter_probability", "persistent_clutter_moving"),
    *("mirrored_clutter_s", "mirrored_clutter_probability", "posts_probability"),
)
COUNTS = ("clutter_per_scan", "persistent_clutter", "mirrored_clutter", "posts_per_km")


class AlteredSettings(WithoutTruthValues):
    """A harder or easier world, made from the sensor's own detections; the data sheet is unchanged."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)

    every_scan: Annotated[int, Field(ge=1, le=100)] = 1
    """Keep one scan of every N, with its truth: 2 turns 10 Hz into 5 Hz."""
    kept_probability: Probability = 1.0
    """Probability that a vehicle's detection is kept."""
    dark_share: Share = 0.0
    """Share of the vehicles that are detected less often than the others, for the whole run."""
    dark_probability: Probability = 1.0
    """Probability that a detection of such a vehicle is kept."""
    burst_share: Share = 0.0
    """Share of each vehicle's time in bursts without a detection."""
    burst_s: Positive = 0.8
    """Mean length of such a burst."""
    hide_s: Annotated[tuple[Annotated[float, Field(gt=0.0, le=60.0)], ...], BeforeValidator(_times)] = ()
    """Durations for which the detections of moving vehicles are withheld (pseudo-occlusion)."""
    hide_share: Share = 0.3
    """Largest share of the detected vehicles that is withheld at one time."""
    half_range_m: Positive | None = None
    """Distance at which half the detections of vehicles are kept (logistic curve); if not set, all are kept.
    """
    false_kept: bool = True
    """Whether the sensor's own false detections are kept."""
    clutter_per_scan: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    """Expected number of single-scan false detections added per scan."""
    persistent_clutter: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    """Expected number of persistent false objects added around the ego."""
    persistent_clutter_s: Positive | None = None
    """Mean lifetime of the added false objects; the sensor's own value if not set (so for all values of added
    objects)."""
    persistent_clutter_probability: Probability | None = None
    """Probability that each of them is detected in a scan."""
    persistent_clutter_moving: Annotated[float | None, Field(ge=0.0, le=1.0)] = None
    """Share of them that moves along a lane with the traffic."""
    mirrored_clutter: Count = 0.0
    """Expected number of added false objects that mirror a real vehicle."""
    mirrored_clutter_s: Positive | None = None
    """Their mean lifetime."""
    mirrored_clutter_probability: Probability | None = None
    """Probability that each of them is detected in a scan."""
    posts_per_km: Annotated[float, Field(ge=0.0, le=1000.0, json_schema_extra={"unit": "1/km"})] = 0.0
    """Expected number of posts and signs added per kilometre of lane."""
    posts_probability: Probability | None = None
    """Probability that each of them is detected in a scan."""
    blind_s: NotNegative = 0.0
    """Duration of repeated blackouts: the sensor delivers no detections."""
    blind_every_s: Positive = 8.0
    """Time from the end of one blackout to the end of the next."""
    ego_std_m: NotNegative = 0.0
    """Standard deviation of the ego's position error, along and across, independent in each scan; it shifts all
    detections."""
    ego_std_deg: NotNegative = 0.0
    """Standard deviation of the ego's heading error, likewise."""

    @model_validator(mode="after")
    def _sees_at_times(self) -> Self:
        if self.blind_s >= self.blind_every_s:
            raise ValueError("blind_s must be below blind_every_s")
        return self

    @property
    def adds(self) -> bool:
        """Whether false detections are added."""
        return any(getattr(self, name) > 0.0 for name in COUNTS)

    def of_added(self, sensor: SensorSettings) -> SensorSettings:
        """Return a sensor's settings with the false detections that are added in place of its own."""
        figures = {name: getattr(self, name) for name in FIGURES if getattr(self, name) is not None}
        return sensor.model_copy(update=figures | {name: getattr(self, name) for name in COUNTS})
