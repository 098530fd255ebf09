"""SUMO's floating-car data: XML, metres, in the plane of the network; positions are those of the front bumper.

Sizes come from the file where it states them, else from the vehicle types in a file beside it (``fcd.vtypes.xml``
beside ``fcd.xml``) or of the network, else from SUMO's defaults.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO
from xml.etree.ElementTree import iterparse

import numpy as np

from harness.common.errors import InputError
from harness.common.untrusted_files import number, reading, unpacked
from harness.truth.network.network import Network, load_network
from harness.truth.recorded.rows import ReadTraffic, rows_in
from harness.truth.sumo.reading import beside_the_road

# SUMO's own sizes of its vehicle classes, metres.
DEFAULT_SIZES = {"passenger": (5.0, 1.8), "truck": (7.1, 2.4), "motorcycle": (2.2, 0.9), "bus": (12.0, 2.5)}
Sizes = dict[str, tuple[float, float]]
ON_FOOT = "person"
TYPES = ".vtypes.xml"

NUMBERS = ("x", "y", "angle", "speed")
SIZES = ("length", "width")


@dataclass
class _Collected:
    """Rows as they come, packed: a recording may have millions."""

    # Vehicles and types by name, numbered as they appear.
    names: dict[str, int] = field(default_factory=dict)
    kinds: dict[str, int] = field(default_factory=dict)
    # One row after the other: vehicle and type; time, x, y, angle, speed, length and width.
    codes: array[int] = field(default_factory=lambda: array("q"))
    numbers: array[float] = field(default_factory=lambda: array("d"))
    people: set[str] = field(default_factory=set)

    def add(self, time_s: float, given: dict[str, str]) -> None:
        """Take in one vehicle at one time."""
        name, kind = given["id"], given.get("type", "")
        self.codes.append(self.names.setdefault(name, len(self.names)))
        self.codes.append(self.kinds.setdefault(kind, len(self.kinds)))
        self.numbers.append(time_s)
        self.numbers.extend([number(given[column]) for column in NUMBERS])
        self.numbers.extend([number(given[column]) if column in given else math.nan for column in SIZES])


def types_file(path: Path) -> Path:
    """Return where the vehicle types of a file of floating-car data are declared, if anywhere."""
    return path.with_name(f"{path.name.removesuffix('.gz').removesuffix('.xml')}{TYPES}")


def declares_types(path: Path) -> bool:
    """Return whether a file, by its name, belongs to floating-car data beside it."""
    return path.name.removesuffix(".gz").endswith(TYPES)


def recording_files(path: Path) -> tuple[Path, ...]:
    """Return the file and, if it is there, that of its vehicle types."""
    types = types_file(path)
    beside = [file for file in (types, types.with_name(f"{types.name}.gz")) if file.is_file()]
    return (path, *beside[:1])


def read_fcd(path: Path, net: str) -> ReadTraffic:
    """Read floating-car data; drop vehicles that never come within 15 m of the network's main road.

    Raises:
        InputError: The file is broken, its time goes back, or a vehicle lacks position, angle or speed.
    """
    network = load_network(net)
    if network.corridor is None:
        raise InputError(f"`net` {net}: floating-car data are read on a network with a main road alone, such as us101")
    with reading(path, "floating-car data with SUMO's usual attributes"):
        with unpacked(path) as file:
            collected = _collect(file)
        types = [network.vehicle_types_file, *recording_files(path)[1:]]
        sizes = dict(size for file in types if file is not None for size in _type_sizes(file))
    if not collected.names:
        raise InputError(f"{path}: it contains no vehicle; give a recording with vehicles")
    return _traffic(collected, network, sizes)


def _collect(file: BinaryIO) -> _Collected:
    collected = _Collected()
    time_s = -np.inf
    root = None
    for event, element in iterparse(file, events=("start", "end")):
        if root is None:
            root = element
        if event == "start" and element.tag == "timestep":
            before, time_s = time_s, number(element.attrib["time"])
            if not time_s > before:
                raise ValueError(f"time goes back from {before:g} s to {time_s:g} s")
        elif event == "end" and element.tag == "vehicle":
            collected.add(time_s, element.attrib)
        elif event == "end" and element.tag == ON_FOOT:
            collected.people.add(element.attrib.get("id", ""))
        elif event == "end" and element.tag == "timestep":
            root.clear()
    return collected


def _traffic(collected: _Collected, network: Network, of_type: Sizes) -> ReadTraffic:
    vehicle, kind = np.frombuffer(collected.codes, dtype=np.int64).reshape(-1, 2).T
    numbers = np.frombuffer(collected.numbers, dtype=np.float64).reshape(len(vehicle), -1)
    time_s, x, y, angle_deg, speed, length_m, width_m = np.ascontiguousarray(numbers.T)
    # SUMO names a type that it drew from another one "other@number".
    sizes = (of_type.get(name) or of_type.get(name.partition("@")[0]) for name in collected.kinds)
    usual_m = np.array([size or DEFAULT_SIZES["passenger"] for size in sizes])[kind]
    length_m = np.where(np.isnan(length_m), usual_m[:, 0], length_m)
    width_m = np.where(np.isnan(width_m), usual_m[:, 1], width_m)
    vehicle_names, people = np.array(list(collected.names)), len(collected.people)
    heading, road = np.radians(90.0 - angle_deg), network.corridor_road
    # The centre is half a length behind the bumper along the heading.
    centre = x - 0.5 * length_m * np.cos(heading), y - 0.5 * length_m * np.sin(heading), heading
    rows = rows_in(road, (0.0, 0.0), np.ascontiguousarray(vehicle), time_s, centre, speed, (length_m, width_m))
    near = np.bincount(vehicle[beside_the_road(road, rows.lat_m)], minlength=len(vehicle_names)) > 0
    left_out = {"never within 15 m of the main road": int(np.sum(~near)), "on foot": people}
    return ReadTraffic(road, vehicle_names, rows.take(near[vehicle]), len(vehicle_names) + people, left_out)


def _type_sizes(path: Path) -> Iterator[tuple[str, tuple[float, float]]]:
    with unpacked(path) as file:
        for _, element in iterparse(file):
            if element.tag == "vType":
                usual = DEFAULT_SIZES.get(element.attrib.get("vClass", "passenger"), DEFAULT_SIZES["passenger"])
                length_m, width_m = (
                    number(element.attrib[name]) if name in element.attrib else usual_m
                    for name, usual_m in zip(SIZES, usual, strict=True)
                )
                yield element.attrib["id"], (length_m, width_m)
