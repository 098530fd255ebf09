"""Parses a network's files: ``network.toml``, a calibration's result, and the user's SUMO configurations."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import AfterValidator, BaseModel, Field, ValidationError, model_validator

from harness.common.bounds import Numbers, row_number
from harness.common.error_text import first_problem
from harness.common.errors import InputError
from harness.common.untrusted_files import read_toml
from harness.storage.schema import DENSITY_RANGE
from harness.truth.network.demand import Drivers, NetworkTable

# More than a lane can carry.
MOST_VEH_PER_H = 5000.0
SHORTEST_SECTION_M = 50.0
Density = Annotated[float, Field(ge=DENSITY_RANGE[0], le=DENSITY_RANGE[1])]

_File = TypeVar("_File", bound=BaseModel)
_Row = TypeVar("_Row", bound=tuple[float, ...])


def _rising(rows: tuple[_Row, ...]) -> tuple[_Row, ...]:
    """Return rows of which the first number rises.

    Raises:
        ValueError: It does not.
    """
    Numbers(rising=True).check("the first number", [row[0] for row in rows], row_number)
    return rows


Rising = Annotated[tuple[_Row, ...], Field(max_length=100_000), AfterValidator(_rising)]


class DemandFile(NetworkTable):
    """A named demand as ``network.toml`` gives it; what is left out follows from the density."""

    description: str
    density_veh_per_km_lane: Density
    on_ramp_veh_per_h: float | None = Field(default=None, ge=0.0, le=MOST_VEH_PER_H)
    off_ramp_veh_per_h: float | None = Field(default=None, ge=0.0, le=MOST_VEH_PER_H)
    wave_amplitude: float | None = Field(default=None, ge=0.0, lt=1.0)
    exit_wave_amplitude: float | None = Field(default=None, ge=0.0, lt=1.0)
    wave_period_s: float | None = Field(default=None, ge=1.0, le=86_400.0)
    schedule: Rising[tuple[Annotated[float, Field(ge=0.0)], Density, Annotated[float, Field(ge=0.0, le=10.0)]]] = ()
    headway_profile: Rising[tuple[float, Annotated[float, Field(ge=0.2, le=5.0)]]] = ()


class NetworkFile(NetworkTable):
    """The content of ``network.toml``."""

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


class PlaneDemandFile(NetworkTable):
    """A named demand of a network in the plane."""

    description: str
    density_veh_per_km_lane: Density


class PlaneNetworkFile(NetworkTable):
    """The content of the ``network.toml`` of a network without one main road, whose road frame is the plane."""

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


class CalibrationFile(NetworkTable):
    """The outcome of a calibration, in a file of its own: it takes the place of what ``network.toml`` says."""

    drivers: Drivers
    demands: dict[str, DemandFile]


def file_of(path: Path, kind: type[_File]) -> _File:
    """Read a TOML file of a network's folder.

    Raises:
        InputError: It can't be read, or an entry is wrong.
    """
    content = read_toml(path, "net")
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
    if "kind" in read_toml(path, "net"):
        return file_of(path, PlaneNetworkFile)
    return file_of(path, NetworkFile)
