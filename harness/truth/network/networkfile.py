"""Parses a network's files: ``network.toml``, a calibration's result, and the user's SUMO configurations."""

from __future__ import annotations

import tomllib
from itertools import pairwise
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from harness.common.error_text import first_problem
from harness.common.errors import InputError
from harness.common.untrusted_files import read_text
from harness.storage.schema import DENSITY_RANGE
from harness.truth.network.demand import Drivers
from mmpf.options.base import WithoutTruthValues

METADATA_FILE = "network.toml"
# More than a lane can carry, and more than drivers differ.
MOST_VEH_PER_H = 5000.0
SHORTEST_SECTION_M = 50.0
HEADWAY_FACTORS = (0.2, 5.0)

_File = TypeVar("_File", bound=BaseModel)


class DemandFile(WithoutTruthValues):
    """A named demand as ``network.toml`` gives it; what is left out follows from the density."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    description: str
    density_veh_per_km_lane: float = Field(ge=DENSITY_RANGE[0], le=DENSITY_RANGE[1])
    on_ramp_veh_per_h: float | None = Field(default=None, ge=0.0, le=MOST_VEH_PER_H)
    off_ramp_veh_per_h: float | None = Field(default=None, ge=0.0, le=MOST_VEH_PER_H)
    wave_amplitude: float | None = Field(default=None, ge=0.0, lt=1.0)
    exit_wave_amplitude: float | None = Field(default=None, ge=0.0, lt=1.0)
    wave_period_s: float | None = Field(default=None, ge=1.0, le=86_400.0)
    schedule: tuple[tuple[float, float, float], ...] = Field(default=(), max_length=100_000)
    headway_profile: tuple[tuple[float, float], ...] = Field(default=(), max_length=10_000)

    @model_validator(mode="after")
    def _schedule_can_be_driven(self) -> DemandFile:
        times = [time_s for time_s, _, _ in self.schedule]
        if any(later <= earlier for earlier, later in pairwise(times)) or any(time_s < 0.0 for time_s in times):
            raise ValueError("schedule: its times must ascend from 0 on")
        if not all(
            DENSITY_RANGE[0] <= density <= DENSITY_RANGE[1] and 0.0 <= share <= 10.0
            for _, density, share in self.schedule
        ):
            raise ValueError(f"schedule: densities are {DENSITY_RANGE[0]:g} to {DENSITY_RANGE[1]:g}, shares 0 to 10")
        places = [place_m for place_m, _ in self.headway_profile]
        if any(later <= earlier for earlier, later in pairwise(places)):
            raise ValueError("headway_profile: its positions must ascend")
        if not all(HEADWAY_FACTORS[0] <= factor <= HEADWAY_FACTORS[1] for _, factor in self.headway_profile):
            raise ValueError(f"headway_profile: factors are {HEADWAY_FACTORS[0]:g} to {HEADWAY_FACTORS[1]:g}")
        return self


class NetworkFile(WithoutTruthValues):
    """The content of ``network.toml``."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    description: str
    net_file: str
    vehicle_types_file: str
    corridor: tuple[str, ...] = Field(min_length=1)
    on_ramps: tuple[str, ...] = ()
    off_ramps: tuple[str, ...] = ()
    corridor_start_m: float
    section_m: tuple[float, float]
    ego_lanes: tuple[int, ...] = Field(min_length=1)
    drivers: Drivers | None = None
    default_demand: str | None = None
    calibration_file: str | None = None
    measured_file: str | None = None
    demands: dict[str, DemandFile] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _section_is_ahead_of_the_start(self) -> NetworkFile:
        start_m, end_m = self.section_m
        if not self.corridor_start_m <= start_m <= end_m - SHORTEST_SECTION_M:
            raise ValueError(
                f"section_m must lie behind corridor_start_m and be at least {SHORTEST_SECTION_M:g} m long"
            )
        return self


class PlaneDemandFile(WithoutTruthValues):
    """A named demand of a network in the plane."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    description: str
    density_veh_per_km_lane: float = Field(ge=DENSITY_RANGE[0], le=DENSITY_RANGE[1])


class PlaneNetworkFile(WithoutTruthValues):
    """The content of the ``network.toml`` of a network without one main road, whose road frame is the plane."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    kind: Literal["plane"]
    description: str
    net_file: str
    routes_file: str
    poly_file: str | None = None
    default_demand: str | None = None
    demands: dict[str, PlaneDemandFile] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _default_is_known(self) -> PlaneNetworkFile:
        if self.default_demand is not None and self.default_demand not in self.demands:
            raise ValueError(f"default_demand {self.default_demand} is none of its demands")
        return self


class CalibrationFile(WithoutTruthValues):
    """The outcome of a calibration, in a file of its own: it takes the place of what ``network.toml`` says."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    drivers: Drivers
    demands: dict[str, DemandFile]


def read_toml(path: Path, kind: type[_File]) -> _File:
    """Read a TOML file of a network's folder.

    Raises:
        InputError: It can't be read, or an entry is wrong.
    """
    content = _toml(path)
    try:
        return kind.model_validate(content)
    except ValidationError as error:
        problem = first_problem(error)
        raise InputError(f"{path}: {problem.key or 'the file'}: {problem.message}") from error


def read_network_file(path: Path) -> NetworkFile | PlaneNetworkFile:
    """Read the ``network.toml`` of a network with a main road, or of one in the plane, which says so by its ``kind``.

    Raises:
        InputError: It can't be read, or an entry is wrong.
    """
    if "kind" in _toml(path):
        return read_toml(path, PlaneNetworkFile)
    return read_toml(path, NetworkFile)


def _toml(path: Path) -> dict[str, object]:
    try:
        return tomllib.loads(read_text(path, "net"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: cannot be read as TOML: {error}") from error
