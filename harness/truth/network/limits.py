"""What a network's XML files may hold: checked in one pass before SUMO or sumolib reads them.

SUMO trusts its input: it loops for ever on a lane whose speed is 0, crashes on one whose length is no number, and
writes wherever an element of an additional file tells it to.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, ParseError, iterparse

from harness.common.errors import InputError
from harness.common.untrusted_files import MB, check_file, number, unpacked

MOST_BYTES = 1024 * MB
MOST_LANES = 500_000
FARTHEST_M = 1e8
# Smallest (exclusive) and largest value of each attribute that is a number.
LANE_LIMITS = {"speed": (0.0, 150.0), "length": (0.0, 1e6), "width": (0.0, 200.0), "index": (-1.0, 1e3)}
TYPE_LIMITS = {
    "length": (0.1, 60.0), "width": (0.1, 10.0), "height": (0.0, 20.0), "minGap": (-1e-9, 100.0), "tau": (0.0, 60.0),
    "accel": (0.0, 50.0), "decel": (0.0, 50.0), "maxSpeed": (0.0, 150.0), "sigma": (-1e-9, 1.0),
    "probability": (-1e-9, 1e9), "impatience": (-1e3, 1.0), "minGapLat": (-1e-9, 10.0), "maxSpeedLat": (-1e-9, 50.0),
    "speedDev": (-1e-9, 2.0), "speedFactor": (0.0, 20.0),
}  # fmt: skip
LARGEST_OF_TYPE = 1e6
"""Of all other numbers that describe a vehicle and its driver."""
FLOW_LIMITS = {
    "number": (-1.0, 1e6), "vehsPerHour": (-1e-9, 1e5), "perHour": (-1e-9, 1e5), "probability": (-1e-9, 1.0),
    "begin": (-1.0, 1e9), "end": (-1.0, 1e9), "depart": (-1.0, 1e9), "departSpeed": (-1e-9, 150.0),
    "arrivalSpeed": (-1e-9, 150.0), "departPos": (-1e6, 1e6), "arrivalPos": (-1e6, 1e6), "departLane": (-1.0, 1e3),
    "arrivalLane": (-1.0, 1e3), "departPosLat": (-200.0, 200.0), "arrivalPosLat": (-200.0, 200.0),
}  # fmt: skip
LIMITS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "lane": LANE_LIMITS,
    "vType": TYPE_LIMITS,
    "flow": FLOW_LIMITS,
    "vehicle": FLOW_LIMITS,
    "trip": FLOW_LIMITS,
}
# Elements that write files, or act at a time on what they name.
OUTPUT_ELEMENTS = frozenset(
    {
        *("inductionLoop", "e1Detector", "instantInductionLoop", "laneAreaDetector", "e2Detector", "e3Detector"),
        *("entryExitDetector", "edgeData", "laneData", "timedEvent", "routeProbe", "calibrator"),
    }
)
INCLUDES = frozenset({"include", "{http://www.w3.org/2001/XInclude}include"})


@dataclass(frozen=True)
class Findings:
    """What a file holds beside its content.

    Attributes:
        outputs: Kinds of elements that would write files, sorted.
    """

    outputs: tuple[str, ...]


def check_xml(path: Path, parameter: str = "net") -> Findings:
    """Go through an XML file of a network: lanes, vehicle types, flows, and what would write files.

    Raises:
        InputError: It is no ordinary or too large a file, is not well-formed, includes others, or holds a value beyond
            what a road or vehicle can have.
    """
    check_file(path, MOST_BYTES, parameter)
    outputs: set[str] = set()
    paths = _Paths()
    lanes = 0
    root: Element | None = None
    try:
        with unpacked(path, MOST_BYTES) as file:
            for event, element in iterparse(file, events=("start", "end")):
                root = element if root is None else root
                if event == "start":
                    continue
                _check_element(element, path)
                paths.note(element)
                if element.tag in OUTPUT_ELEMENTS:
                    outputs.add(element.tag)
                lanes += element.tag == "lane"
                if lanes > MOST_LANES:
                    raise InputError(f"{path}: more than {MOST_LANES} lanes; cut out the part that is driven on")
                element.clear()
                if len(root) > 1000:
                    root.clear()
    except (ParseError, UnicodeDecodeError, OSError, EOFError, ValueError) as error:
        raise InputError(f"{path}: not well-formed XML: {error}") from None
    paths.check(path)
    return Findings(tuple(sorted(outputs)))


@dataclass
class _Paths:
    """The paths across junctions, which SUMO follows without looking whether any connection leads to them."""

    listed: dict[str, str] = field(default_factory=dict)
    connected: set[str] = field(default_factory=set)

    def note(self, element: Element) -> None:
        """Take in what a junction lists or a connection names."""
        if element.tag == "junction" and element.get("type") != "internal":
            self.listed |= dict.fromkeys(element.get("intLanes", "").split(), element.get("id", "?")[:60])
        elif element.tag == "connection":
            ends = ((element.get(end), element.get(f"{end}Lane")) for end in ("from", "to"))
            self.connected |= {f"{edge}_{lane}" for edge, lane in ends if edge and edge.startswith(":")}
            self.connected.add(element.get("via", ""))

    def check(self, path: Path) -> None:
        """Refuse a path that no connection names."""
        for lane, junction in self.listed.items():
            if lane not in self.connected:
                raise InputError(
                    f"{path}: junction {junction} lists the path {lane[:60]}, to which no connection leads; make the "
                    "network again with netconvert"
                )


def write_without_outputs(path: Path, copy: Path) -> None:
    """Write a copy of an additional file without the elements that would write files."""
    with unpacked(path, MOST_BYTES) as file:
        tree = ElementTree(file=file)
    root = tree.getroot()
    assert root is not None
    for parent in root.iter():
        for child in [child for child in parent if child.tag in OUTPUT_ELEMENTS]:
            parent.remove(child)
    tree.write(copy, encoding="utf-8", xml_declaration=True)


def _check_element(element: Element, path: Path) -> None:
    if element.tag in INCLUDES:
        raise InputError(f"{path}: it includes another file, {element.get('href', '?')[:60]}; put its content in here")
    if element.tag == "param" and _names_a_file(element.get("key", "")):
        raise InputError(f"{path}: the parameter {element.get('key')} would write a file; remove it")
    for name, (above, most) in LIMITS.get(element.tag, {}).items():
        text = element.get(name)
        value = _number(text)
        if value is not None and not above < value <= most:
            who = element.get("id", "?")[:60]
            raise InputError(f"{path}: {element.tag} {who} has {name} {text}; give {max(above, 0.0):g} to {most:g}")
    if element.tag == "vType":
        for name, text in element.items():
            value = None if name == "id" else _number(text)
            if value is not None and not abs(value) <= LARGEST_OF_TYPE:
                who = element.get("id", "?")[:60]
                raise InputError(f"{path}: vType {who} has {name} {text[:40]}; no driver is described by that")
    for name in ("shape", "pos"):
        text = element.get(name)
        if text and element.tag in ("lane", "edge", "junction"):
            _check_shape(text, element, path)


def _names_a_file(key: str) -> bool:
    return key == "file" or key.endswith((".file", "-file", "-output", ".output"))


def _number(text: str | None) -> float | None:
    """Return the number that a text is; None for what is none, such as a distribution, which SUMO judges."""
    if text is None:
        return None
    # SUMO reads hexadecimal numbers where others are expected.
    for read in (float, float.fromhex) if "x" in text.lower() else (float,):
        try:
            return read(text)
        except (ValueError, OverflowError):
            continue
    return None


def _check_shape(text: str, element: Element, path: Path) -> None:
    try:
        values = [number(word) for point in text.split() for word in point.split(",")]
    except ValueError:
        values = [math.nan]
    if not all(abs(value) <= FARTHEST_M for value in values):
        who = element.get("id", "?")[:60]
        raise InputError(f"{path}: the shape of {element.tag} {who} is no list of points within {FARTHEST_M:g} m")
