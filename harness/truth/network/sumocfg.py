"""The user's SUMO configurations: only their inputs and vehicle behaviour are used.

A configuration can make SUMO write anywhere, wait for a connection, or load programs. So SUMO never reads it: its
files and those options that decide the traffic alone are handed over one by one, the rest is left out.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import parse

from harness.common.bounds import Numbers, check_numbers
from harness.common.errors import InputError
from harness.common.untrusted_files import number_or_nan, reading, require_file
from harness.truth.network.limits import PLAUSIBLE

FILE_OPTIONS = {
    "net-file": ("net-file", "net", "n"),
    "route-files": ("route-files", "r"),
    "additional-files": ("additional-files", "additional", "a"),
}
UNITS_S = (1.0, 60.0, 3600.0, 86_400.0)
TIMES = {"begin": ("begin", "b"), "end": ("end", "e")}
# They are the harness's to set.
OWN = frozenset({"step-length", "seed", "random", "step-method.ballistic"})
BEHAVIOUR = frozenset(PLAUSIBLE["behaviour"]["options"])
PLAIN_VALUE = re.compile(r"[A-Za-z0-9_.:+-]{1,40}")
NUMBERS_OF_OPTIONS = {name: Numbers(ends[0], ends[3]) for name, ends in PLAUSIBLE["option"].items()}


@dataclass(frozen=True)
class SumoInputs:
    """What is taken from a configuration."""

    net_file: Path
    route_files: tuple[Path, ...]
    additional_files: tuple[Path, ...]
    options: tuple[tuple[str, str], ...]
    left_out: tuple[str, ...]


def read_sumocfg(path: Path) -> SumoInputs:
    """Read a configuration and check the files that it names.

    Raises:
        InputError: A file is missing, malformed or beyond the limits, or no network is named.
    """
    require_file(path, f"`net` {path}")
    with reading(path, "well-formed XML"):
        root = parse(path).getroot()
    values = {node.tag: node.get("value", node.get("v", "")) for node in root.iter() if node.attrib}
    named = {option: _named_files(path, values, aliases) for option, aliases in FILE_OPTIONS.items()}
    if len(named["net-file"]) != 1:
        raise InputError(f"`net` {path}: it must name one net-file")
    for file in (*named["route-files"], *named["additional-files"]):
        require_file(file, f"`net` {path}: of what it names")
    known = {alias for aliases in (*FILE_OPTIONS.values(), *TIMES.values()) for alias in aliases}
    left_out = sorted({name for name in values if name not in known | OWN | BEHAVIOUR} - {root.tag})
    return SumoInputs(
        net_file=named["net-file"][0],
        route_files=tuple(named["route-files"]),
        additional_files=tuple(named["additional-files"]),
        options=tuple(_options(path, values)),
        left_out=tuple(left_out),
    )


def _options(path: Path, values: dict[str, str]) -> list[tuple[str, str]]:
    """Return the options that are handed over; the run itself decides when it ends."""
    times = {option: values[alias] for option, aliases in TIMES.items() for alias in aliases if values.get(alias)}
    taken = times | {name: values[name].strip() for name in sorted(BEHAVIOUR & values.keys())}
    for name, value in taken.items():
        if not PLAIN_VALUE.fullmatch(value):
            raise InputError(f"`net` {path}: {name} is {value[:40]!r}; give a plain number or word")
    told = {name: _seconds(text) for name, text in taken.items()}
    check_numbers(f"`net` {path}", told, NUMBERS_OF_OPTIONS, "the configuration", "give a number")
    return [(name, value) for name, value in taken.items() if name != "end"]


def _seconds(text: str) -> float:
    """Return a number, or a time such as ``7:30:00`` or ``1:7:30:00`` with days before it in seconds; nan of others."""
    parts = [number_or_nan(part) for part in reversed(text.split(":"))]
    return sum(map(math.prod, zip(parts, UNITS_S, strict=False))) if len(parts) in (1, 3, 4) else math.nan


def _named_files(path: Path, values: dict[str, str], aliases: tuple[str, ...]) -> list[Path]:
    names = next((values[alias] for alias in aliases if values.get(alias)), "")
    return [path.parent / name.strip() for name in names.replace(",", " ").split()]
