"""What the files of a network's folder hold: ``network.toml`` and the outcome of a calibration."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from harness.errors import InputError
from harness.truth.network.demand import DENSITY_RANGE, Drivers
from harness.writing.problems import first_problem

METADATA_FILE = "network.toml"

_File = TypeVar("_File", bound=BaseModel)


class DemandFile(BaseModel):
    """A named demand as ``network.toml`` gives it; what is left out follows from the density."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    description: str
    density_veh_per_km_lane: float = Field(ge=DENSITY_RANGE[0], le=DENSITY_RANGE[1])
    on_ramp_veh_per_h: float | None = Field(default=None, ge=0.0)
    off_ramp_veh_per_h: float | None = Field(default=None, ge=0.0)
    wave_amplitude: float | None = Field(default=None, ge=0.0, lt=1.0)
    exit_wave_amplitude: float | None = Field(default=None, ge=0.0, lt=1.0)
    wave_period_s: float | None = Field(default=None, gt=0.0)
    schedule: tuple[tuple[float, float, float], ...] = ()
    headway_profile: tuple[tuple[float, float], ...] = ()


class NetworkFile(BaseModel):
    """The content of ``network.toml``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

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
    demands: dict[str, DemandFile] = {}

    @model_validator(mode="after")
    def _section_is_ahead_of_the_start(self) -> NetworkFile:
        if not self.corridor_start_m <= self.section_m[0] < self.section_m[1]:
            raise ValueError("section_m must lie behind corridor_start_m and must not be empty")
        return self


class CalibrationFile(BaseModel):
    """The outcome of a calibration, in a file of its own: it takes the place of what ``network.toml`` says."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    drivers: Drivers
    demands: dict[str, DemandFile]


def read_toml(path: Path, kind: type[_File]) -> _File:
    """Read a TOML file of a network's folder.

    Args:
        path: The file.
        kind: What it must hold.

    Raises:
        InputError: It can't be read, or an entry is wrong.
    """
    try:
        return kind.model_validate(tomllib.loads(path.read_text(encoding="utf-8")))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise InputError(f"{path}: cannot be read as TOML: {error}") from error
    except ValidationError as error:
        problem = first_problem(error)
        raise InputError(f"{path}: {problem.key or 'the file'}: {problem.message}") from error
