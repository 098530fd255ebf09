"""Bounds on lanes, vehicles and flows: a network's XML files are checked in one pass before SUMO reads them."""

from __future__ import annotations

import re
import zlib
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, iterparse

import numpy as np

from harness.common.bounds import PLACE_M, Numbers, check_numbers
from harness.common.errors import InputError
from harness.common.untrusted_files import number, number_or_nan, require_file, unpacked
from harness.truth.network.lanegraph import ROAD_VEHICLES
from harness.truth.network.polyline import doubles_back, length_of

# Lanes of one edge share a length, so that a short or bent one is not as long as it says.
ROUGH_M = 20.0
# Smallest and largest plausible value of each attribute that is a number. The 290 types, 113 000 lanes and 1 400 phases
# of three public collections of SUMO scenarios lie within.
LANE = {"speed": (1e-3, 120.0), "length": (1e-3, 1e6), "width": (0.1, 50.0), "index": (0.0, 1e3)}
ROAD_WIDTH_M = Numbers(1.0, 8.0)
"""Of a lane that road vehicles may use."""
TYPE = {
    "length": (0.1, 60.0), "width": (0.1, 4.5), "height": (0.1, 6.0), "mass": (1.0, 5e5), "minGap": (0.0, 10.0),
    "tau": (0.1, 5.0), "accel": (0.1, 15.0), "decel": (0.1, 15.0), "emergencyDecel": (0.1, 20.0), "sigma": (0.0, 1.0),
    "maxSpeed": (0.2, 120.0), "speedFactor": (0.1, 3.0), "speedDev": (0.0, 0.5), "actionStepLength": (-1.0, 3.0),
    "probability": (0.0, 1e9), "impatience": (-1e3, 1.0), "minGapLat": (0.0, 3.0), "maxSpeedLat": (0.0, 5.0),
    "lcPushy": (0.0, 1.0), "lcCooperative": (-1.0, 1.0), "jmIgnoreFoeProb": (0.0, 1.0), "startupDelay": (0.0, 60.0),
}  # fmt: skip
LONGEST_M = {"pedestrian": 2.0, "bicycle": 4.0, "moped": 4.0, "motorcycle": 4.0}
"""Longest body of small classes; a type without a class is SUMO's passenger car, as buses are too in some files."""
OF_TYPE = Numbers(-1e6, 1e6)
"""Of all other numbers that describe a vehicle and its driver."""
FLOW = {
    "number": (0.0, 1e6), "vehsPerHour": (0.0, 1e5), "perHour": (0.0, 1e5), "probability": (0.0, 1.0),
    "begin": (0.0, 1e9), "end": (0.0, 1e9), "depart": (0.0, 1e9), "departSpeed": (0.0, 120.0),
    "arrivalSpeed": (0.0, 120.0), "departPos": (-1e6, 1e6), "arrivalPos": (-1e6, 1e6), "departLane": (0.0, 1e3),
    "arrivalLane": (0.0, 1e3), "departPosLat": (-200.0, 200.0), "arrivalPosLat": (-200.0, 200.0),
}  # fmt: skip
PHASE = {"duration": (0.0, 86_400.0)}
BEGINS_NUMBER = re.compile(r"\s*((nan|inf|infinity)\s*$|[-+.0-9](?!.*:))", re.IGNORECASE)
"""What a word that means a number begins with; a time of day is none."""
RED = set("ru")
"""Letters of a signal at which vehicles wait: red, and red with amber."""
OF_TAGS = {"lane": LANE, "vType": TYPE, "flow": FLOW, "vehicle": FLOW, "trip": FLOW, "phase": PHASE}
LIMITS = {tag: {name: Numbers(*ends) for name, ends in table.items()} for tag, table in OF_TAGS.items()}


def check_xml(path: Path, names_no_place: bool = False) -> None:
    """Go through an XML file of a network: lanes, vehicle types and flows that no road and no driver has.

    Args:
        path: The file.
        names_no_place: Whether it may not lead out of its folder, where the kernel can't keep SUMO from writing there.

    Raises:
        InputError: It is not well-formed, holds a value beyond what a road or vehicle can have, or its edges and
            signals let nobody through.
    """
    require_file(path, f"`net`: {path.parent}")
    root: Element | None = None
    ends: dict[str, tuple[str, str]] = {}
    letters: set[str] = set()
    try:
        with unpacked(path) as file:
            for event, element in iterparse(file, events=("start", "end")):
                root = element if root is None else root
                if event == "start":
                    continue
                if names_no_place:
                    _check_names_no_place(element, path)
                _check_element(element, path)
                _check_way_through(element, ends, letters, path)
                element.clear()
                if len(root) > 1000:
                    root.clear()
    except (ParseError, UnicodeDecodeError, OSError, EOFError, ValueError, zlib.error) as error:
        raise InputError(f"{path}: not well-formed XML: {error}") from None


def _check_names_no_place(element: Element, path: Path) -> None:
    for name, value in element.items():
        if name != "id" and (value.startswith(("/", "~", "$")) or ".." in value):
            raise InputError(f"{path}: {element.tag} names a place, {value[:60]}; leave it out")


def _check_way_through(element: Element, ends: dict[str, tuple[str, str]], letters: set[str], path: Path) -> None:
    """Check an element against earlier ones: where the edges end, and the letters of the present plan of signals."""
    start, end, name = (element.get(key, "") for key in ("from", "to", "id"))
    if element.tag == "edge" and not element.get("function"):
        ends[name] = start, end
    elif element.tag == "connection" and {start, end} <= ends.keys() and ends[start][1] != ends[end][0]:
        raise InputError(f"{path}: connection from {start[:60]} to {end[:60]}: they do not meet: fix or remove it")
    elif element.tag == "phase":
        letters |= set(element.get("state", ""))
    elif element.tag == "tlLogic":
        if letters and letters <= RED:
            raise InputError(f"{path}: tlLogic {name[:60]}: its state is red in every phase: fix or remove it")
        letters.clear()


def _check_element(element: Element, path: Path) -> None:
    allowed = LIMITS.get(element.tag, {})
    if element.tag == "vType":
        longest_m = LONGEST_M.get(element.get("vClass", ""), allowed["length"].most)
        allowed = dict.fromkeys(set(element.keys()) - {"id"}, OF_TYPE) | allowed | {"length": Numbers(0.1, longest_m)}
    elif element.tag == "lane" and _is_for_roads(element):
        allowed = allowed | {"width": ROAD_WIDTH_M}
    given = {name: values for name in allowed if (values := _numbers(element.get(name, "")))}
    check_numbers(path, given, allowed, f"{element.tag} {element.get('id', '?')[:60]}")
    for text in filter(None, map(element.get, ("shape", "pos"))):
        if element.tag in ("lane", "edge", "junction"):
            _check_shape(text, element, path)


def _is_for_roads(lane: Element) -> bool:
    allowed, closed = (set(lane.get(key, "").split()) for key in ("allow", "disallow"))
    return bool(allowed & ROAD_VEHICLES) if allowed else not closed & {"all", "passenger"}


def _numbers(text: str) -> list[float]:
    """Return the numbers of a text: one, several as of a colour, a distribution's mean and bounds; none of a word."""
    words = text.rpartition("(")[2].rstrip(")").split(",")
    spoken = words[:1] + words[1 + text.startswith("norm") :]
    return [number_or_nan(word) for word in spoken if BEGINS_NUMBER.match(word)]


def _check_shape(text: str, element: Element, path: Path) -> None:
    who = f"{element.tag} {element.get('id', '?')[:60]}"
    try:
        points = [[number(word) for word in point.split(",")] for point in text.split()]
        PLACE_M.check("the shape", [value for point in points for value in point], who)
        if element.tag != "lane" or not _is_for_roads(element):
            return  # that of a pavement may be its outline
        line = np.array([point[:2] for point in points])
        if doubles_back(line):
            raise ValueError("it doubles back")
        for stated_m in _numbers(element.get("length", "")):
            Numbers(0.5 * stated_m - ROUGH_M, 1.5 * stated_m + ROUGH_M).check("its length", length_of(line))
    except ValueError as error:
        raise InputError(f"{path}: the shape of {who} is no list of points: {error}") from None
