"""SUMO configuration files of the user's own, checked before SUMO sees them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from harness.errors import InputError

_FILE_OPTIONS = {
    "net-file": ("net-file", "net", "n"),
    "route-files": ("route-files", "r"),
    "additional-files": ("additional-files", "additional", "a"),
}


@dataclass(frozen=True)
class SumoConfiguration:
    """What is needed of a ``.sumocfg``.

    Attributes:
        path: The file.
        net_file: The network that it names.
        begin_s: Simulation time at the start.
    """

    path: Path
    net_file: Path
    begin_s: float


def read_sumocfg(path: Path) -> SumoConfiguration:
    """Read a configuration and check that the files that it names are there and are XML.

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
    return SumoConfiguration(path=path, net_file=named["net-file"][0], begin_s=_begin(path, values))


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


def _begin(path: Path, values: dict[str, str]) -> float:
    try:
        return float(values.get("begin") or values.get("b") or 0.0)
    except ValueError:
        raise InputError(f"`net` {path}: begin must be a number of seconds") from None
