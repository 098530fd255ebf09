"""Bounds on lanes, vehicles and flows: a network's XML files are checked in one pass before SUMO reads them."""

import re
import tomllib
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, iterparse

import numpy as np

from harness.common.bounds import PLACE_M, Numbers, check_numbers
from harness.common.errors import InputError
from harness.common.untrusted_files import number, number_or_nan, reading, require_file, unpacked
from harness.truth.network.consistency import NetParts, contradictions
from harness.truth.network.lanegraph import ROAD_VEHICLES
from harness.truth.network.polyline import doubles_back

# By which a lane may be longer than drawn, or is usually: lanes of an edge share a length.
AS_DRAWN, USUALLY_DRAWN = (0.5, 20.0), (0.1, 2.0)
Range = tuple[float, float, float, float]
"""Below the first and above the last number nothing is possible; below the second and above the third it is unusual."""
PLAUSIBLE: dict[str, dict[str, Any]] = tomllib.loads(Path(__file__).with_name("plausible.toml").read_text("utf-8"))
BEGINS_NUMBER = re.compile(r"\s*((nan|inf|infinity)\s*$|[-+.0-9](?!.*:))", re.IGNORECASE)
"""What a word that means a number begins with; a time of day is none."""


def check_xml(*paths: Path, names_no_place: bool = False) -> list[str]:
    """Go through the XML files of a network: lanes, vehicle types and flows that no road and no driver has.

    Args:
        *paths: The files, that of the network first, those of the demand last.
        names_no_place: Whether none may lead out of its folder, where the kernel can't keep SUMO from writing there.

    Returns:
        Of each value that is possible but unusual, what it is and what is usual.

    Raises:
        InputError: One is not well-formed, holds a value beyond what a road or vehicle can have, or its edges and
            signals let nobody through.
    """
    parts, unusual = NetParts(), list[str]()
    for path in paths:
        require_file(path, f"`net`: {path.parent}")
        root: Element | None = None
        with reading(path, "XML"), unpacked(path) as file:
            for event, element in iterparse(file, events=("start", "end")):
                root = element if root is None else root
                if event == "start":
                    continue
                if names_no_place:
                    _check_names_no_place(element, path)
                unusual += _check_element(element, path)
                parts.add(element, element.tag == "lane" and _is_for_roads(element))
                element.clear()
                if len(root) > 1000:
                    del root[:]
    with reading(paths[0], "network"):
        return unusual + list(contradictions(parts, paths[0]))


def _check_names_no_place(element: Element, path: Path) -> None:
    for name, value in element.items():
        if name != "id" and (value.startswith(("/", "~", "$")) or ".." in value):
            raise InputError(f"{path}: {element.tag} names a place, {value[:60]}; leave it out")


def _check_element(element: Element, path: Path) -> list[str]:
    """Refuse an element that is not possible, and return what is unusual about it."""
    if element.tag == "include" or "}" in element.tag:  # SUMO reads the file too, and heeds no namespace
        raise InputError(f"{path}: {element.tag[:60]} is not checked: give its content here, and no namespace (xmlns)")
    ranges, who = _ranges_of(element), f"{element.tag} {element.get('id', '?')[:60]}"
    given = {name: values for name in ranges if (values := _numbers(element.get(name, "")))}
    check_numbers(path, given, {name: Numbers(ends[0], ends[3]) for name, ends in ranges.items() if name in given}, who)
    told = [
        f"{name} of {who} is {value:g}, {least:g} to {most:g} is usual"
        for name, values in given.items()
        for _, least, most, _ in [ranges[name]]
        for value in values
        if not least <= value <= most
    ]
    if element.tag == "vType":
        _check_type(element, path, who)
    for text in filter(None, map(element.get, ("shape", "pos"))):
        if element.tag in ("lane", "edge", "junction", "poly"):
            told += _check_shape(text, element, path, who)
    return told


def _ranges_of(element: Element) -> dict[str, Range]:
    tag = {"vehicle": "flow", "trip": "flow"}.get(element.tag, element.tag)
    ranges: dict[str, Range] = PLAUSIBLE[tag] if tag in ("lane", "vType", "flow", "phase") else {}
    if tag == "vType":
        kind = PLAUSIBLE["class_like"].get(element.get("vClass", ""), element.get("vClass", ""))
        ranges = ranges | PLAUSIBLE["class"].get(kind, {})
        return dict.fromkeys(set(element.keys()) - {"id"} - ranges.keys(), PLAUSIBLE["vType_other"]["any"]) | ranges
    return ranges | PLAUSIBLE["lane_of_roads"] if tag == "lane" and _is_for_roads(element) else ranges


def _check_type(element: Element, path: Path, who: str) -> None:
    numbers = {name: _numbers(element.get(name, "")) for name in set(element.keys()) & PLAUSIBLE["vType"].keys()}
    if worded := sorted(name for name, values in numbers.items() if not values):
        raise InputError(f"{path}: {worded[0]} of {who} is {element.get(worded[0], '')[:40]!r}: give a number")
    hardest, usual = (max(numbers.get(name, [0.0])) for name in ("emergencyDecel", "decel"))
    if 0.0 < hardest < usual:
        raise InputError(f"{path}: emergencyDecel of {who} is {hardest:g}, below its decel of {usual:g}: raise it")


def _is_for_roads(lane: Element) -> bool:
    allowed, closed = (set(lane.get(key, "").split()) for key in ("allow", "disallow"))
    return bool(allowed & ROAD_VEHICLES) if allowed else not closed & {"all", "passenger"}


def _numbers(text: str) -> list[float]:
    """Return the numbers of a text: one, several as of a colour, a distribution's mean and bounds; none of a word."""
    words = text.rpartition("(")[2].rstrip(")").split(",")
    spoken = words[:1] + words[1 + text.startswith("norm") :]
    return [number_or_nan(word) for word in spoken if BEGINS_NUMBER.match(word)]


def _check_shape(text: str, element: Element, path: Path, who: str) -> list[str]:
    try:
        points = [[number(word) for word in point.split(",")] for point in text.split()]
        PLACE_M.check("the shape", [value for point in points for value in point], who)
        if element.tag != "lane" or not _is_for_roads(element):
            return []  # that of a pavement may be its outline
        line = np.array([(*point, 0.0)[:3] for point in points])
        told = [f"{who} doubles back"] * doubles_back(line)
        drawn_m = float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())
        for stated_m in _numbers(element.get("length", "")):
            most_m, usual_m = (share * stated_m + rough_m for share, rough_m in (AS_DRAWN, USUALLY_DRAWN))
            Numbers(stated_m - most_m, stated_m + most_m).check("its length", drawn_m)
            if abs(drawn_m - stated_m) > usual_m:
                told.append(f"{who} is drawn {drawn_m:.4g} m long and said to be {stated_m:g} m")
    except ValueError as error:
        raise InputError(f"{path}: the shape of {who} is no list of points: {error}") from None
    return told
