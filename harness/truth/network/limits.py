"""Bounds on lanes, vehicles and flows: a network's XML files are checked in one pass before SUMO reads them."""

from __future__ import annotations

import math
import zlib
from collections.abc import Mapping
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, iterparse

from harness.common.errors import InputError
from harness.common.untrusted_files import number, unpacked

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


def check_xml(path: Path) -> None:
    """Go through an XML file of a network: lanes, vehicle types and flows that no road and no driver has.

    Raises:
        InputError: It is not well-formed, or holds a value beyond what a road or vehicle can have.
    """
    if not path.is_file():
        raise InputError(f"`net`: {path} does not exist or is not a regular file")
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
