"""The user's SUMO configurations: only their inputs and vehicle behaviour are used.

A configuration can make SUMO write anywhere, wait for a connection, or load programs. So SUMO never reads it: its
files and those options that decide the traffic alone are handed over one by one, the rest is left out.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import ParseError, parse

from harness.common.bounds import Numbers, check_numbers
from harness.common.errors import InputError
from harness.common.untrusted_files import number, require_file

FILE_OPTIONS = {
    "net-file": ("net-file", "net", "n"),
    "route-files": ("route-files", "r"),
    "additional-files": ("additional-files", "additional", "a"),
}
TIMES = {"begin": ("begin", "b"), "end": ("end", "e")}
# They are the harness's to set.
OWN = frozenset({"step-length", "seed", "random", "step-method.ballistic"})
BEHAVIOUR = frozenset(
    {
        *("ignore-route-errors", "ignore-accidents", "ignore-junction-blocker", "max-depart-delay", "max-num-vehicles"),
        *("time-to-teleport", "time-to-teleport.highways", "time-to-teleport.disconnected", "time-to-impatience"),
        *("lateral-resolution", "collision.action", "collision.check-junctions", "collision.mingap-factor"),
        *("collision.stoptime", "insertion-checks", "emergency-insert", "eager-insert", "sloppy-insert", "scale"),
        *("default.action-step-length", "default.carfollowmodel", "default.emergencydecel", "default.speeddev"),
        *("lanechange.duration", "lanechange.overtake-right", "pedestrian.model", "routing-algorithm"),
        *("random-depart-offset", "extrapolate-departpos", "keep-after-arrival", "tls.all-off"),
        *("device.rerouting.probability", "device.rerouting.period", "device.rerouting.adaptation-steps"),
        *("device.rerouting.adaptation-interval", "device.rerouting.pre-period", "device.rerouting.with-taz"),
    }
)
PLAIN_VALUE = re.compile(r"[A-Za-z0-9_.:+-]{1,40}")
SECONDS = Numbers(-1e9, 1e9)
NUMBERS_OF_BEHAVIOUR = {
    "scale": Numbers(0.0, 20.0), "lateral-resolution": Numbers(0.05, 10.0), "default.speeddev": Numbers(0.0, 2.0),
    "default.emergencydecel": Numbers(0.0, 50.0), "lanechange.duration": Numbers(0.0, 60.0),
    "collision.mingap-factor": Numbers(-1.0, 100.0),
}  # fmt: skip


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
    try:
        root = parse(path).getroot()
    except (ParseError, UnicodeDecodeError, OSError, ValueError) as error:
        raise InputError(f"{path}: not well-formed XML: {error}") from None
    values = {node.tag: node.get("value", node.get("v", "")) for node in root.iter() if node.attrib}
    named = {option: _named_files(path, values, aliases) for option, aliases in FILE_OPTIONS.items()}
    if len(named["net-file"]) != 1:
        raise InputError(f"`net` {path}: it must name one net-file")
    for file in (*named["route-files"], *named["additional-files"]):
        require_file(file, f"`net` {path}: of what it names")
    options = [*_times(path, values), *_behaviour(path, values)]
    known = {alias for aliases in (*FILE_OPTIONS.values(), *TIMES.values()) for alias in aliases}
    left_out = sorted({name for name in values if name not in known | OWN | BEHAVIOUR} - {root.tag})
    return SumoInputs(
        net_file=named["net-file"][0],
        route_files=tuple(named["route-files"]),
        additional_files=tuple(named["additional-files"]),
        options=tuple(options),
        left_out=tuple(left_out),
    )


def _times(path: Path, values: dict[str, str]) -> list[tuple[str, str]]:
    taken = []
    for option, aliases in TIMES.items():
        text = next((values[alias] for alias in aliases if values.get(alias)), "")
        if not text:
            continue
        check_numbers(f"`net` {path}", {option: _finite(text)}, {option: SECONDS}, "the configuration", "give seconds")
        # The run itself decides when it ends.
        if option == "begin":
            taken.append((option, text))
    return taken


def _behaviour(path: Path, values: dict[str, str]) -> list[tuple[str, str]]:
    taken = []
    for name in sorted(BEHAVIOUR & values.keys()):
        value = values[name].strip()
        if not PLAIN_VALUE.fullmatch(value):
            raise InputError(f"`net` {path}: {name} is {value[:40]!r}; give a plain number or word")
        taken.append((name, value))
    told = {name: _finite(text) for name, text in taken}
    check_numbers(f"`net` {path}", told, NUMBERS_OF_BEHAVIOUR, "the configuration", "give a number")
    return taken


def _finite(text: str) -> float:
    """Return the number that a text is; nan for what is none."""
    try:
        return number(text)
    except ValueError:
        return math.nan


def _named_files(path: Path, values: dict[str, str], aliases: tuple[str, ...]) -> list[Path]:
    names = next((values[alias] for alias in aliases if values.get(alias)), "")
    return [path.parent / name.strip() for name in names.replace(",", " ").split()]
