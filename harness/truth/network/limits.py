"""Bounds on lanes, vehicles and flows: a network's XML files are checked in one pass before SUMO reads them."""

from __future__ import annotations

import math
import zlib
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, iterparse

import numpy as np

from harness.common.bounds import PLACE_M, Numbers, check_numbers
from harness.common.errors import InputError
from harness.common.untrusted_files import number, require_file, unpacked
from harness.truth.network.polyline import doubles_back, length_of

# Lanes of one edge share a length, so that a short or bent one is not as long as it says.
ROUGH_M = 20.0
# Smallest and largest value of each attribute that is a number.
LANE = {"speed": (1e-3, 150.0), "length": (1e-3, 1e6), "width": (1e-3, 200.0), "index": (0.0, 1e3)}
TYPE = {
    "length": (0.1, 60.0), "width": (0.1, 10.0), "height": (1e-3, 20.0), "minGap": (0.0, 50.0), "tau": (0.05, 10.0),
    "accel": (1e-3, 20.0), "decel": (1e-3, 20.0), "maxSpeed": (1e-3, 150.0), "sigma": (0.0, 1.0),
    "probability": (0.0, 1e9), "impatience": (-1e3, 1.0), "minGapLat": (0.0, 10.0), "maxSpeedLat": (0.0, 50.0),
    "speedDev": (0.0, 2.0), "speedFactor": (1e-3, 20.0),
}  # fmt: skip
OF_TYPE = Numbers(-1e6, 1e6)
"""Of all other numbers that describe a vehicle and its driver."""
FLOW = {
    "number": (0.0, 1e6), "vehsPerHour": (0.0, 1e5), "perHour": (0.0, 1e5), "probability": (0.0, 1.0),
    "begin": (0.0, 1e9), "end": (0.0, 1e9), "depart": (0.0, 1e9), "departSpeed": (0.0, 150.0),
    "arrivalSpeed": (0.0, 150.0), "departPos": (-1e6, 1e6), "arrivalPos": (-1e6, 1e6), "departLane": (0.0, 1e3),
    "arrivalLane": (0.0, 1e3), "departPosLat": (-200.0, 200.0), "arrivalPosLat": (-200.0, 200.0),
}  # fmt: skip
OF_TAGS = {"lane": LANE, "vType": TYPE, "flow": FLOW, "vehicle": FLOW, "trip": FLOW}
LIMITS = {tag: {name: Numbers(*ends) for name, ends in table.items()} for tag, table in OF_TAGS.items()}


def check_xml(path: Path) -> None:
    """Go through an XML file of a network: lanes, vehicle types and flows that no road and no driver has.

    Raises:
        InputError: It is not well-formed, or holds a value beyond what a road or vehicle can have.
    """
    require_file(path, f"`net`: {path.parent}")
    root: Element | None = None
    try:
        with unpacked(path) as file:
            for event, element in iterparse(file, events=("start", "end")):
                root = element if root is None else root
                if event == "start":
                    continue
                _check_element(element, path)
                element.clear()
                if len(root) > 1000:
                    root.clear()
    except (ParseError, UnicodeDecodeError, OSError, EOFError, ValueError, zlib.error) as error:
        raise InputError(f"{path}: not well-formed XML: {error}") from None


def check_names_no_place(path: Path) -> None:
    """Refuse a file that names another place, where the kernel can't keep SUMO from writing there.

    Raises:
        InputError: A value of it begins like a path that leads out of the file's folder.
    """
    with unpacked(path) as file:
        for _, element in iterparse(file):
            for name, value in element.items():
                if name != "id" and (value.startswith(("/", "~", "$")) or ".." in value):
                    raise InputError(f"{path}: {element.tag} names a place, {value[:60]}; leave it out")


def _check_element(element: Element, path: Path) -> None:
    allowed = LIMITS.get(element.tag, {})
    if element.tag == "vType":
        allowed = dict.fromkeys(set(element.keys()) - {"id"}, OF_TYPE) | allowed
    given = {name: value for name in allowed if (value := _number(element.get(name, ""))) is not None}
    check_numbers(path, given, allowed, f"{element.tag} {element.get('id', '?')[:60]}")
    for text in filter(None, map(element.get, ("shape", "pos"))):
        if element.tag in ("lane", "edge", "junction"):
            _check_shape(text, element, path)


def _number(text: str) -> float | None:
    """Return the number that a text is; None for what begins like none, such as a distribution, or is a time of day."""
    # SUMO reads hexadecimal numbers where others are expected.
    for read in (float, float.fromhex) if "x" in text.lower() else (float,):
        try:
            return read(text)
        except (ValueError, OverflowError):
            continue
    return math.nan if text[:1] in "+-.0123456789" and text and ":" not in text else None


def _check_shape(text: str, element: Element, path: Path) -> None:
    who = f"{element.tag} {element.get('id', '?')[:60]}"
    try:
        points = [[number(word) for word in point.split(",")] for point in text.split()]
        PLACE_M.check("the shape", [value for point in points for value in point], who)
        line, stated_m = np.array(points)[:, :2], _number(element.get("length", ""))
        if element.tag == "lane" and doubles_back(line):
            raise ValueError("it doubles back")
        if element.tag == "lane" and stated_m is not None:
            Numbers(0.5 * stated_m - ROUGH_M, 1.5 * stated_m + ROUGH_M).check("its length", length_of(line))
    except ValueError as error:
        raise InputError(f"{path}: the shape of {who} is no list of points: {error}") from None
