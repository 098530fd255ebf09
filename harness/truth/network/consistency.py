"""Checks that the elements of a network agree with each other, as they do in every network that netconvert writes."""

import math
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import combinations, pairwise
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
import shapely

from harness.common.errors import InputError
from harness.common.untrusted_files import number_or_nan
from harness.truth.network.polyline import beside
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.numerics.arrays import FloatArray

Attributes = dict[str, str]
MEETING_M, WIDEST_JUNCTION_M = 2.0, 150.0
"""Lanes that are joined end and begin within the former, or the latter where no path leads across the junction."""
BESIDE_M, USUAL_WIDTH_M = 1.5, 3.2
"""Lanes of an edge lie beside each other as far as their widths, SUMO's if they tell none, within the former."""
PLACES = np.linspace(0.0, 1.0, 9)
WRONG_SHARE = 0.01
"""Of so many connections of real networks and not more the state disagrees with the table of right of way."""
NEVER_GREEN, WAITING, FREE, OF_NO_TABLE = set("ruyY"), "msw", "MO-", "=Z"
"""Letters of signals at which nobody drives, of connections that wait for others or do not, and that no table tells."""
NOBODY_WAITS = ("unregulated", "dead_end", "district")


@dataclass
class NetParts:
    """What of the elements of a network and its demand is compared with each other.

    Attributes:
        edges: Edges by name, paths across junctions left out.
        order: The numbers of each edge's lanes, as they stand in the file.
        length_m: Each edge's length by what its longest lane tells.
        lanes: The middle line, shape (p, 2), and the width of each lane for road vehicles, metres.
        links: The connections.
        junctions: The junctions, each with the rows of its table of right of way.
        plans: The plans of signals, each with its phases.
        side: On which side of a lane the next one of its edge lies: 1 for the left, -1 where traffic keeps left.
        told: What of an element contradicts itself or one before it, a clause each.
    """

    edges: dict[str, Attributes] = field(default_factory=dict)
    order: dict[str, list[str]] = field(default_factory=lambda: defaultdict(list))
    length_m: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    lanes: dict[str, tuple[FloatArray, float]] = field(default_factory=dict)
    links: list[Attributes] = field(default_factory=list)
    junctions: list[tuple[Attributes, list[Attributes]]] = field(default_factory=list)
    plans: list[tuple[Attributes, list[Attributes]]] = field(default_factory=list)
    side: int = 1
    told: list[str] = field(default_factory=list)
    _rows: list[Attributes] = field(default_factory=list)
    _ends: dict[str, tuple[str, str]] = field(default_factory=dict)

    def add(self, element: Element, for_roads: bool) -> None:
        """Keep an element of the file, all of whose children have been added; lanes with whether they are for roads."""
        tag, name, attributes = element.tag, element.get("id", ""), dict(element.attrib)
        if tag == "edge" and "function" not in attributes:
            self.edges[name] = attributes
        elif tag == "lane":
            edge, _, number = name.rpartition("_")
            self.order[edge].append(number)
            if attributes.get("index", number) != number and not edge.startswith(":"):  # there netconvert errs
                self.told.append(f"lane {name[:60]} has the index {attributes['index'][:9]}")
            self.length_m[edge] = max(self.length_m[edge], float(attributes.get("length", math.inf)))
            if for_roads and (points := _points(attributes)):
                self.lanes[name] = np.array(points), float(attributes.get("width", USUAL_WIDTH_M))
        elif tag == "connection":
            self.links.append(attributes)
        elif tag in ("request", "phase"):
            self._rows.append(attributes)
        elif tag in ("junction", "tlLogic"):
            (self.junctions if tag == "junction" else self.plans).append((attributes, self._rows))
            self._rows = []
        elif tag == "net" and attributes.get("lefthand") in ("true", "1"):
            self.side = -1
        elif tag == "route":  # one within a vehicle has no name
            edges = attributes.get("edges", "").split() or [""]
            self._ends[name] = edges[0], edges[-1]
        elif tag in ("vehicle", "trip", "flow"):
            first, last = self._ends.get(attributes.get("route", ""), ("", ""))
            for key, edge in (("departPos", attributes.get("from", first)), ("arrivalPos", attributes.get("to", last))):
                if abs(number_or_nan(attributes.get(key, ""))) > (end_m := self.length_m.get(edge, math.inf)):
                    self.told.append(f"{key} of {tag} {name[:60]} is beyond the {end_m:g} m of edge {edge[:60]}")
            self._ends.pop("", None)


def _points(attributes: Attributes) -> list[list[float]]:
    return [[float(word) for word in point.split(",")[:2]] for point in attributes.get("shape", "").split()]


def contradictions(parts: NetParts, path: Path) -> Iterator[str]:
    """Yield what of a network contradicts something else of it, a clause each.

    Raises:
        InputError: Nobody can get through: connected lanes do not meet, or a plan of signals is red for all.
    """
    yield from parts.told
    yield from _of_lanes(parts)
    yield from _of_links(parts, path)
    yield from _of_junctions(parts)
    yield from _of_signals(parts, path)


def _of_lanes(parts: NetParts) -> Iterator[str]:
    at = {its.get("id"): [number_or_nan(its.get(axis, "")) for axis in "xy"] for its, _ in parts.junctions}
    for edge, its in parts.edges.items():
        lines = [parts.lanes[name][0] for number in parts.order[edge] if (name := f"{edge}_{number}") in parts.lanes]
        ends = [(its.get(key), line[end]) for key, end in (("from", 0), ("to", -1)) for line in lines]
        if any(math.dist(place, at.get(junction, place)) > WIDEST_JUNCTION_M for junction, place in ends):
            yield f"edge {edge[:60]} is far from its junctions"
        if (numbers := parts.order[edge]) != list(map(str, range(len(numbers)))):
            yield f"the lanes of edge {edge[:60]} are not in order"
        for one, other in pairwise(f"{edge}_{number}" for number in numbers):
            if {one, other} <= parts.lanes.keys():
                (line, width_m), (next_line, next_width_m) = parts.lanes[one], parts.lanes[other]
                apart_m, left_m = beside(line, next_line, PLACES)
                if np.abs(apart_m - 0.5 * (width_m + next_width_m)).max() > BESIDE_M:
                    yield f"lane {other[:60]} is {apart_m.min():.3g} to {apart_m.max():.3g} m from the one beside it"
                if parts.side * left_m.mean() < 0.0:
                    yield f"lane {other[:60]} lies on the wrong side of the one before it: mirrored, or x and y swapped"
    way, balance = {(its.get("from"), its.get("to")): edge for edge, its in parts.edges.items()}, 0.0
    for (start, end), edge in way.items():
        inner, oncoming = (f"{each}_{len(parts.order[each]) - 1}" for each in (edge, way.get((end, start), "")))
        if {inner, oncoming} <= parts.lanes.keys():
            apart_m, left_m = beside(parts.lanes[inner][0], parts.lanes[oncoming][0][::-1], PLACES)
            if 0.5 * USUAL_WIDTH_M < apart_m.max() < 2.0 * USUAL_WIDTH_M:
                balance += parts.side * np.sign(left_m.mean())
    if balance < 0.0:  # on single roads it is meant, as where carriageways cross over
        yield "traffic of most roads drives on the wrong side of what comes towards it: mirrored, or x and y swapped"


def _of_links(parts: NetParts, path: Path) -> Iterator[str]:
    leads_to = {_lane(link, "from"): _lane(link, "to") for link in parts.links}
    begun = Counter(link["via"] for link in parts.links if "via" in link)
    left = Counter(_lane(link, "from") for link in parts.links)
    ways: dict[tuple[str, str], list[tuple[int, int]]] = defaultdict(list)
    for link in parts.links:
        start, end, via = link.get("from", ""), link.get("to", ""), link.get("via", "")
        ways[start, end].append((int(link.get("fromLane", 0)), int(link.get("toLane", 0))))
        lanes, edges = (_lane(link, "from"), via or _lane(link, "to")), (start, end)
        apart = parts.edges.keys() >= {*edges} and parts.edges[start].get("to") != parts.edges[end].get("from")
        if parts.lanes.keys() >= {*lanes}:
            (line, _), (next_line, _) = (parts.lanes[lane] for lane in lanes)
            most_m = MEETING_M if via or start.startswith(":") else WIDEST_JUNCTION_M
            apart |= math.dist(line[-1], next_line[0]) > most_m
        if apart:
            raise InputError(f"{path}: connection from {start[:60]} to {end[:60]}: they do not meet: fix or remove it")
        if via and (begun[via] > 1 or left[via] > 1 or leads_to.get(via) != _lane(link, "to")):
            yield f"path {via[:60]} of a connection to {end[:60]} is another's too, or leads elsewhere"
    for (start, end), way in ways.items():
        if any((one - other) * (to - other_to) < 0 for (one, to), (other, other_to) in combinations(way, 2)):
            yield f"connections from {start[:60]} to {end[:60]} cross each other"


def _lane(link: Attributes, which: str) -> str:
    return f"{link.get(which)}_{link.get(f'{which}Lane')}"


def _tables(parts: NetParts) -> Iterator[tuple[Attributes, list[Attributes], list[Attributes]]]:
    """Yield each junction with the rows of its table of right of way, and the connection that each is of."""
    of_path = {link["via"]: link for link in parts.links if "via" in link}
    of_lane: dict[str, list[Attributes]] = defaultdict(list)
    for link in parts.links:
        of_lane[_lane(link, "from")].append(link)
    for at, rows in parts.junctions:
        if at.get("type") != "internal":
            paths, into = at.get("intLanes", "").split(), at.get("incLanes", "").split()
            links = [of_path.get(lane, {}) for lane in paths] or [link for lane in into for link in of_lane[lane]]
            yield at, rows, links


def _of_junctions(parts: NetParts) -> Iterator[str]:
    leading: dict[str, set[str]] = defaultdict(set)
    for edge, its in parts.edges.items():
        leading[its.get("to", "")].update(f"{edge}_{number}" for number in parts.order[edge])
    agree: list[bool] = []
    for at, rows, links in _tables(parts):
        name, into = at.get("id", ""), at.get("incLanes", "").split()
        waits, foes = ([row.get(key, "")[::-1] for row in rows] for key in ("response", "foes"))
        for_no_foe = [("1", "0") in zip(*row, strict=False) for row in zip(waits, foes, strict=True)]
        its_own = [row[k : k + 1] == "1" for k, row in enumerate(foes)]
        lost = [lane for lane, link in zip(at.get("intLanes", "").split(), links, strict=False) if not link]
        faults = {
            "names other lanes than lead to it": leading[name] != {lane for lane in into if not lane.startswith(":")},
            "has not one row, and place in it, for each connection": rows
            and {len(links)} != {len(rows), *map(len, waits), *map(len, foes)},
            "has a path of no connection": parts.lanes.keys() & lost,
            "lets some wait for no foe, or for themselves": any(for_no_foe + its_own),
            "lets some wait, but nobody by its type": at.get("type") in NOBODY_WAITS and "1" in "".join(waits),
        }
        yield from (f"junction {name[:60]} {fault}" for fault, there in faults.items() if there)
        for link, row in zip(links, waits, strict=False):
            state, is_within = link.get("state", "="), link.get("from", ":").startswith(":")
            if state not in OF_NO_TABLE and not is_within and "tl" not in link:
                agree.append(state in (WAITING if "1" in row else FREE))
    if agree.count(False) > WRONG_SHARE * len(agree):
        yield f"the states of {agree.count(False)} of {len(agree)} connections disagree with their junctions"


def _of_signals(parts: NetParts, path: Path) -> Iterator[str]:
    used: dict[str, set[int]] = defaultdict(set)
    foes: dict[str, set[tuple[int, int]]] = defaultdict(set)
    for link in parts.links:
        used[link.get("tl", "")].add(int(link.get("linkIndex", 0)))
    for _, rows, links in _tables(parts):
        for link, row in zip(links, rows, strict=False):
            marked = [other for other, mark in zip(links, row.get("foes", "")[::-1], strict=False) if mark == "1"]
            for other in (each for each in marked if "tl" in each and each["tl"] == link.get("tl")):
                foes[link["tl"]].add((int(link.get("linkIndex", 0)), int(other.get("linkIndex", 0))))
    for at, phases in parts.plans:
        name, states = at.get("id", ""), [phase.get("state", "") for phase in phases]
        stuck = {k for k, letters in enumerate(zip(*states, strict=False)) if set(letters) <= NEVER_GREEN}
        if stuck and len(stuck) == max(map(len, states)):
            raise InputError(f"{path}: tlLogic {name[:60]}: its state is red in every phase: fix or remove it")
        green = [{k for k, letter in enumerate(state) if letter == "G"} for state in states]
        if stuck & used[name]:
            yield f"signal {min(stuck & used[name])} of tlLogic {name[:60]} is never green"
        if any(together >= {*pair} for together in green for pair in foes[name]):
            yield f"signals of tlLogic {name[:60]} are green for foes at once"


def lanes_under_walls(road: LaneGraphRoad) -> int:
    """Return how many lanes have a wall across their middle line."""
    if road.walls_xy is None:
        return 0
    points = np.diff(road.graph.first_point)
    lines = shapely.linestrings(road.graph.xy, indices=np.repeat(np.arange(len(points)), points))
    walls = shapely.STRtree([shapely.LineString(ends) for ends in road.walls_xy.reshape(-1, 2, 2)])
    return len(np.unique(walls.query(lines, predicate="intersects")[0]))
