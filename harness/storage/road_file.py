"""The road of a run in a file of its folder: its lanes and reference line, or a graph of lanes with walls."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.bounds import PLACE_M, Numbers
from harness.common.files import write_text
from harness.common.isolation import ProcessLimits, isolated
from harness.common.untrusted_files import check_file, reading
from mmpf.map.control import LinkControl
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import LaneGraph
from mmpf.map.limits import MOST_POINTS, graph_problem, lanes_problem
from mmpf.map.road import Lane, Road

CONTROL_INTEGERS = ("kind", "signal", "foe", "first_foe")
FLOATS, INTEGERS = ("width_m", "speed_limit_mps"), ("left", "right", "successor", "first_successor", "first_point")


def write_road(road: Road, path: Path) -> None:
    """Write a road so that a replay needs no network."""
    columns = ("lanes", "reference_xy", "reference_start_m", "section_m")
    fields: dict[str, Any] = {name: getattr(road, name) for name in columns}
    fields["lanes"] = [asdict(lane) for lane in road.lanes]
    if not isinstance(road, LaneGraphRoad):
        write_text(path, json.dumps(fields, indent=1) + "\n")
        return
    graph = road.graph
    table: dict[str, Any] = {"name": list(graph.name)}
    table |= {name: getattr(graph, name).tolist() for name in ("xy", *FLOATS, *INTEGERS)}
    table["in_junction"] = np.flatnonzero(graph.in_junction).tolist()
    if (control := graph.control) is not None:
        numbers = {name: getattr(control, name).tolist() for name in CONTROL_INTEGERS}
        table["control"] = {"signal_name": list(control.signal_name), **numbers}
    fields["graph"] = table
    if road.walls_xy is not None:
        fields["walls_xy"] = road.walls_xy.tolist()
    write_text(path, json.dumps(fields, separators=(",", ":")) + "\n")


def read_road(path: Path, parameter: str) -> Road:
    """Return the road that a file holds."""
    check_file(path, parameter)
    return isolated(partial(_road, path, parameter), f"`{parameter}`: {path}", ProcessLimits.for_files([path]))


def _road(path: Path, parameter: str) -> Road:
    with reading(f"`{parameter}`: {path}", "road of a run"):
        fields = json.loads(path.read_bytes())
        road = CorridorRoad(
            lanes=tuple(Lane(**lane) for lane in fields["lanes"]),
            reference_xy=tuple((float(x), float(y)) for x, y in fields["reference_xy"]),
            reference_start_m=float(fields["reference_start_m"]),
            section_m=(float(fields["section_m"][0]), float(fields["section_m"][1])),
        )
        walls_xy = None
        if "walls_xy" in fields:
            walls_xy = np.array(fields["walls_xy"], dtype=np.float64).reshape(-1, 4)
            Numbers(0, MOST_POINTS).check("the count of its walls", len(walls_xy))
            PLACE_M.check("a wall", walls_xy)
        points = np.array(road.reference_xy, dtype=np.float64).reshape(-1, 2)
        Numbers(2, 100_000).check("the count of points of its reference line", len(points))
        PLACE_M.check("its reference line", points)
        Numbers(1e-9).check("the way between two points of its reference line", np.hypot(*np.diff(points, axis=0).T))
        PLACE_M.check("its begin", road.reference_start_m)
        Numbers(PLACE_M.least, PLACE_M.most, rising=True).check("its section", road.section_m)
        if "graph" not in fields:
            if problem := lanes_problem(road.lanes):
                raise ValueError(problem)
            if walls_xy is not None:
                raise ValueError("it has walls but no graph of lanes")
            return road
        if replace(road, section_m=CorridorRoad.section_m) != CorridorRoad(lanes=()):
            raise ValueError("beside a graph of lanes its frame must be the plane")
        return LaneGraphRoad(_graph_of(fields["graph"]), road.section_m, walls_xy)


def _graph_of(table: Mapping[str, Any]) -> LaneGraph:
    """Return the graph that a table holds.

    Raises:
        ValueError: It is none, or larger than can be held; so are KeyError, TypeError and OverflowError.
    """
    names = _texts(table["name"], "a lane's name")
    in_junction = np.zeros(len(names), dtype=np.bool_)
    in_junction[_integers(table["in_junction"])] = True
    columns: dict[str, Any] = {name: np.array(table[name], dtype=np.float64) for name in FLOATS}
    columns |= {name: _integers(table[name]) for name in INTEGERS}
    points = np.array(table["xy"], dtype=np.float64).reshape(-1, 2)
    control = None
    if "control" in table:
        held = table["control"]
        numbers = {name: _integers(held[name]) for name in CONTROL_INTEGERS}
        control = LinkControl(signal_name=_texts(held["signal_name"], "a signal's name"), **numbers)
    graph = LaneGraph(name=names, xy=points, in_junction=in_junction, control=control, **columns)
    if problem := graph_problem(graph):
        raise ValueError(problem)
    return graph


def _texts(values: Sequence[object], what: str) -> tuple[str, ...]:
    if not all(isinstance(value, str) for value in values):
        raise ValueError(f"{what} is no text")
    return tuple(map(str, values))


def _integers(values: Sequence[int]) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    found = np.array(values)
    if found.size and found.dtype.kind != "i":
        raise ValueError("an index of the lanes is not a whole number")
    return found.astype(np.int64)
