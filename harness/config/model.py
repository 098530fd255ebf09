"""A run's configuration: its fields, and the checks on it."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Field, PrivateAttr, model_validator

from harness.config.altered import AlteredSettings
from harness.storage.schema import DENSITY_RANGE
from mmpf.options.base import CodeName, WithoutTruthValues
from mmpf.options.filter import FilterOptions

DEFAULT_TRACKER = "mmpf"
DEFAULT_DRIVER = "hdm"
# Letters take up to four of the 255 bytes that a name may have, and some mark a folder that is being written.
LONGEST_FOLDER_NAME = 120

# What the project's own tracker takes where the user says nothing; other trackers have defaults of their own.
MMPF_DEFAULTS: dict[str, str | int] = {
    "model": "residual",
    "update": FilterOptions().update,
    "particles": FilterOptions().particles,
}


MAP_BELIEFS = ("map", "map_shift_m", "lanes_left_out")


class _Strict(WithoutTruthValues):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)


class RecordingConfig(_Strict):
    """Which recorded traffic takes the simulated one's place."""

    format: CodeName
    """Name of the file's format."""
    ego: Annotated[str, Field(min_length=1)] = "auto"
    """Name of the vehicle that carries the sensor, ``auto``, or ``each`` for every vehicle in turn."""
    start_s: Annotated[float, Field(ge=0.0, le=1e8)] = 0.0
    """Start of the run in the recording, in seconds after its first row."""
    least_score: float | None = Field(default=None, json_schema_extra={"unit": "the detector's score"})
    """For recordings with their own detections: detections with a lower score are dropped. The format sets the default.
    """
    map: bool = False
    """For recordings with their own detections: use the recording's map as the road; otherwise a plane without
    lanes."""


class TrafficConfig(_Strict):
    """Which traffic is driven, and for how long."""

    net: Annotated[str, Field(min_length=1)] = "us101"
    """Name of a bundled network, or a folder or ``.sumocfg`` file."""
    demand: Annotated[str, Field(min_length=1)] | None = None
    """Name of one of the network's demands; excludes ``density``. The network's default if neither is given."""
    density: Annotated[float, Field(ge=DENSITY_RANGE[0], le=DENSITY_RANGE[1])] | None = Field(
        default=None, json_schema_extra={"unit": "veh/km/lane"}
    )
    """Vehicles per kilometre and main lane; excludes ``demand``. 30 if neither is given and the network names no
    default demand, unless it is a SUMO configuration with a demand of its own.
    """
    duration_s: Annotated[float, Field(ge=0.1, le=86_400.0)] = 60.0
    """Scored time in seconds, not counting the warm-up. For a recording, the seconds used."""
    broken_down: Annotated[int, Field(ge=0, le=100)] = 0
    """Number of broken-down vehicles in main lanes of the section. They stand there from the first frame on; other
    vehicles steer around them.
    """
    recording: RecordingConfig | None = None
    """Set where the traffic was recorded on a real road; there is neither demand nor density then."""

    @model_validator(mode="after")
    def _one_way_to_set_traffic(self) -> Self:
        if self.demand is not None and self.density is not None:
            raise ValueError("give either `demand` or `density`, not both")
        if self.recording is not None:
            if self.demand is not None or self.density is not None:
                raise ValueError("recorded traffic is as it was; leave demand and density out")
            if self.broken_down:
                raise ValueError("recorded traffic is as it was; leave broken_down out")
        return self


class SensorConfig(_Strict):
    """Which sensor looks at the traffic.

    Any other key overrides the profile's setting of that name, for example ``range_m``.
    """

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False, use_attribute_docstrings=True)

    profile: CodeName = "lidar"
    """Name of the sensor profile."""

    @property
    def overrides(self) -> dict[str, object]:
        """Settings that differ from the profile's."""
        return dict(self.model_extra or {})


class BeliefsConfig(_Strict):
    """What trackers are given about sensor and road; by default the correct data sheet and map."""

    detection_probability: Annotated[float, Field(ge=1e-3, le=1.0)] | None = None
    """Probability of detecting a vehicle in plain view."""
    clutter_per_scan: Annotated[float, Field(ge=0.0, le=1000.0)] | None = None
    """Expected number of false detections a scan."""
    noise_factor: Annotated[float, Field(ge=1e-3, le=100.0)] | None = None
    """Factor on every reported deviation, applied before any tracker; 1 if not set."""
    full_view_fraction: Annotated[float, Field(gt=0.0, le=1.0)] | None = None
    """Visible fraction from which a vehicle is in plain view."""
    hidden_fraction: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    """Visible fraction below which a vehicle is not detected."""
    range_m: Annotated[float, Field(ge=1.0, le=1e4)] | None = None
    """Distance beyond which nothing is detected."""
    map: Literal["one-lane", "none"] | None = None
    """Lanes that trackers know: ``none``, or (main roads) ``one-lane``, as wide as all lanes; if not set, all lanes."""
    map_shift_m: Annotated[float, Field(ge=-100.0, le=100.0)] | None = None
    """Shift of the trackers' map to the left of the true one; to the north in the plane."""
    lanes_left_out: tuple[int, ...] | None = None
    """Numbers of main-road lanes that are missing in the trackers' map."""

    @model_validator(mode="after")
    def _no_map_has_no_lanes(self) -> Self:
        idle = [name for name in ("map_shift_m", "lanes_left_out") if getattr(self, name)]
        if self.map == "none" and idle:
            raise ValueError(f"map none leaves no lanes to shift or leave out; leave out map or {' and '.join(idle)}")
        return self

    def sheet(self) -> dict[str, float]:
        """Return what is believed otherwise than the data sheet says, by its names."""
        return dict(self.model_dump(exclude_none=True, exclude={"noise_factor", *MAP_BELIEFS}))

    @property
    def of_the_map(self) -> bool:
        """Whether the map is believed to be another than it is."""
        return any(getattr(self, name) is not None for name in MAP_BELIEFS)


class TrackerConfig(_Strict):
    """Which tracker follows the vehicles."""

    name: CodeName = DEFAULT_TRACKER
    """Name of the tracker."""
    model: CodeName | None = None
    """Name of the motion model, for trackers that take one."""
    update: Annotated[str, Field(min_length=1)] | None = None
    """Name of the measurement update, for trackers that have several."""
    particles: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    """Particles per vehicle, for particle filters."""
    model_file: Annotated[str, Field(min_length=1)] | None = None
    """File of a fitted behaviour model; replaces the bundled one."""
    options: dict[str, Any] = Field(default_factory=dict)
    """The tracker's own settings by name."""
    believes: BeliefsConfig = Field(default_factory=BeliefsConfig)
    """Sensor and road data that trackers assume."""
    knows_signals: bool = False
    """Whether trackers receive the state of the traffic signals with each scan."""
    _factory: Callable[..., Any] | None = PrivateAttr(default=None)

    @property
    def maker(self) -> str | Callable[..., Any]:
        """What builds the tracker: its name, or the function that Python handed over in its place."""
        return self.name if self._factory is None else self._factory

    @model_validator(mode="after")
    def _defaults_of_the_own_tracker(self) -> Self:
        if self.name == DEFAULT_TRACKER:
            for name, value in MMPF_DEFAULTS.items():
                if getattr(self, name) is None:
                    object.__setattr__(self, name, value)
        return self

    def in_words(self) -> str:
        """Return the tracker's label with its motion model and update rule."""
        model = f" with the motion model {self.model}" if self.model else ""
        rule = " and the paper's update rule" if self.update == "max_likelihood" else ""
        return f"{self.name}{model}{rule}"

    def all_options(self) -> dict[str, object]:
        """Return everything that is set as the options of the tracker's factory."""
        named = {name: getattr(self, name) for name in ("model", "update", "particles", "model_file")}
        return {name: value for name, value in named.items() if value is not None} | self.options


class DecisionsConfig(_Strict):
    """Which driver is asked what it would do by the truth and by the tracks."""

    driver: CodeName = DEFAULT_DRIVER
    """Name of the driver."""


class RunConfig(_Strict):
    """Everything that decides a run's results; same configuration and versions, same results."""

    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    """Root seed of all random numbers."""
    replay: Annotated[str, Field(min_length=1)] | None = None
    """Run folder whose recorded truth and detections are used in place of SUMO and the sensor, or a file of traffic
    recorded on a real road.
    """
    traffic: TrafficConfig = Field(default_factory=TrafficConfig)
    """The traffic."""
    sensor: SensorConfig = Field(default_factory=SensorConfig)
    """The sensor."""
    altered: AlteredSettings = Field(default_factory=AlteredSettings)
    """What is done to the detections after the sensor made them, or after they were recorded."""
    tracker: TrackerConfig = Field(default_factory=TrackerConfig)
    """The tracker."""
    decisions: DecisionsConfig = Field(default_factory=DecisionsConfig)
    """What the tracks would do to driving."""
    metric: CodeName | None = None
    """Metric of your own, ``module:function``; every metric that its module registers is scored."""

    def as_table(self) -> dict[str, object]:
        """Return the configuration as nested plain values without what is not set; the form of ``config.toml``."""
        table = self.model_dump(exclude_none=True)
        for group, name in (("tracker", "believes"), ("tracker", "knows_signals"), ("traffic", "broken_down")):
            if not table[group][name]:
                del table[group][name]
        if self.altered == AlteredSettings():
            del table["altered"]
        if self.decisions == DecisionsConfig():
            # Nothing that a run records depends on it, and folders of runs that knew no driver stay the same.
            del table["decisions"]
        return table

    def tracked_by(self, factory: Callable[..., Any]) -> Self:
        """Return the same configuration with a function that builds the tracker; no file can hold one."""
        tracker = self.tracker.model_copy()
        tracker._factory = factory
        return self.model_copy(update={"tracker": tracker})

    def title(self) -> str:
        """Return what is run in a few words."""
        traffic, tracker = self.traffic, self.tracker
        demand = (
            f"{traffic.density:g} veh/km/lane"
            if traffic.density is not None
            else traffic.demand and f"demand {traffic.demand}"
        )
        if traffic.recording is not None and self.replay is not None:
            road = "" if traffic.net == "recording" else f" on {traffic.net}"
            where = f"recording {Path(self.replay).stem}{road}"
            where += "" if traffic.recording.ego in ("auto", "ego") else f", seen from vehicle {traffic.recording.ego}"
        else:
            where = f"traffic on {traffic.net}" + (f", {demand}" if demand else "")
            where += f", {traffic.broken_down} broken down" if traffic.broken_down else ""
        return f"{tracker.in_words()}: {where}"

    def default_folder_name(self) -> str:
        """Return a name for the run's folder that contains its main settings."""
        traffic = self.traffic
        demand = f"d{traffic.density:g}" if traffic.density is not None else traffic.demand
        network = traffic.net.rstrip("/").rsplit("/", 1)[-1].removesuffix(".sumocfg")
        if traffic.recording is not None and self.replay is not None:
            network, demand = Path(self.replay).stem, f"ego-{traffic.recording.ego}"
        broken = f"broken{traffic.broken_down}" if traffic.broken_down else None
        usual = RunConfig()
        sensor = None if self.sensor.profile == usual.sensor.profile else self.sensor.profile.rpartition(":")[2]
        duration = None if traffic.duration_s == usual.traffic.duration_s else f"{traffic.duration_s:g}s"
        update = None if self.tracker.update in (None, MMPF_DEFAULTS["update"]) else self.tracker.update
        own = [self.tracker.name, self.tracker.model, update]
        parts = [network, *own, demand, broken, sensor, duration, f"s{self.seed}"]
        return re.sub(r"[^\w.+-]+", "-", "-".join(part for part in parts if part))[:LONGEST_FOLDER_NAME]


def brings_its_own_demand(net: str) -> bool:
    """Whether a network is a SUMO configuration of the user's own, with its own vehicles."""
    path = Path(net)
    return path.suffix == ".sumocfg" or (path.is_dir() and not (path / "network.toml").is_file())
