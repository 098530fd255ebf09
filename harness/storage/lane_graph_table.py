"""Converts a lane graph to and from the table in a run's folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from harness.common.bounds import PLACE_M, Numbers
from mmpf.map.control import LinkControl
from mmpf.map.lane_graph import LaneGraph
from mmpf.map.limits import MOST_POINTS, graph_problem
from mmpf.numerics.arrays import FloatArray

CONTROL_INTEGERS = ("kind", "signal", "foe", "first_foe")
FLOATS, INTEGERS = ("width_m", "speed_limit_mps"), ("left", "right", "successor", "first_successor", "first_point")


def graph_table(graph: LaneGraph) -> dict[str, Any]:
    """Return a graph as lists; numbers are read back as the same."""
    table: dict[str, Any] = {"name": list(graph.name)}
    table |= {name: getattr(graph, name).tolist() for name in ("xy", *FLOATS, *INTEGERS)}
    table["in_junction"] = np.flatnonzero(graph.in_junction).tolist()
    if (control := graph.control) is not None:
        numbers = {name: getattr(control, name).tolist() for name in CONTROL_INTEGERS}
        table["control"] = {"signal_name": list(control.signal_name), **numbers}
    return table


def graph_of(table: Mapping[str, Any]) -> LaneGraph:
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
    problem = graph_problem(graph)
    if problem:
        raise ValueError(problem)
    return graph


def _texts(values: Sequence[object], what: str) -> tuple[str, ...]:
    if not all(isinstance(value, str) for value in values):
        raise ValueError(f"{what} is no text")
    return tuple(map(str, values))


def walls_of(rows: Sequence[Sequence[float]]) -> FloatArray:
    """Return walls as rows of both ends' x and y, metres, shape (w, 4).

    Raises:
        ValueError: They are none, or too many or too far away.
    """
    walls = np.array(rows, dtype=np.float64).reshape(-1, 4)
    Numbers(0, MOST_POINTS).check("the count of its walls", len(walls))
    PLACE_M.check("a wall", walls)
    return walls


def _integers(values: Sequence[int]) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    found = np.array(values)
    if found.size and found.dtype.kind != "i":
        raise ValueError("an index of the lanes is not a whole number")
    return found.astype(np.int64)
