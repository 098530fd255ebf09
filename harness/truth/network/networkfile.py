"""What a network's files hold: ``network.toml``, a calibration's outcome, SUMO configurations of the user's own."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TypeVar
from xml.etree import ElementTree

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from harness.errors import InputError
from harness.truth.network.demand import DENSITY_RANGE, Drivers
from harness.writing.problems import first_problem

METADATA_FILE = "network.toml"
_FILE_OPTIONS = {
    "net-file": ("net-file", "net", "n"),
    "route-files": ("route-files", "r"),
    "additional-files": ("additional-files", "additional", "a"),
}

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


def net_file_of(path: Path) -> Path:
    """Return the network that a ``.sumocfg`` names, after checking that the files that it names are there and are XML.

    Raises:
        InputError: A file is missing or malformed, or no network is named.
    """
    if not path.is_file():
        raise InputError(f"`net` {path}: the file does not exist")
    values = {node.tag: node.get("value", "") for node in parse_xml(path).iter()}
    named = {option: _named_files(path, values, aliases) for option, aliases in _FILE_OPTIONS.items()}
    if len(named["net-file"]) != 1:
        raise InputError(f"`net` {path}: it must name one net-file")
    for file in (*named["route-files"], *named["additional-files"]):
        if not file.is_file():
            raise InputError(f"`net` {path}: it names {file.name}, which does not exist")
        if file.suffix == ".xml":
            parse_xml(file)
    try:
        float(values.get("begin") or values.get("b") or 0.0)
    except ValueError:
        raise InputError(f"`net` {path}: begin must be a number of seconds") from None
    return named["net-file"][0]


def parse_xml(path: Path) -> ElementTree.Element:
    """Return an XML file's root.

    Raises:
        InputError: The file is not well-formed.
    """
    try:
        return ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, UnicodeDecodeError, OSError) as error:
        raise InputError(f"{path}: not well-formed XML: {error}") from error


def _named_files(path: Path, values: dict[str, str], aliases: tuple[str, ...]) -> list[Path]:
    names = next((values[alias] for alias in aliases if values.get(alias)), "")
    return [path.parent / name.strip() for name in names.replace(",", " ").split()]
