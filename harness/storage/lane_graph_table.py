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
    return {
        "name": list(graph.name),
        **{name: getattr(graph, name).tolist() for name in ("xy", *FLOATS, *INTEGERS)},
        "in_junction": np.flatnonzero(graph.in_junction).tolist(),
        **({} if graph.control is None else {"control": _control_table(graph.control)}),
    }


def _control_table(control: LinkControl) -> dict[str, Any]:
    return {
        "signal_name": list(control.signal_name),
        **{name: getattr(control, name).tolist() for name in CONTROL_INTEGERS},
    }


def graph_of(table: Mapping[str, Any]) -> LaneGraph:
    """Return the graph that a table holds.

    Raises:
        ValueError: It is none, or larger than can be held; so are KeyError, TypeError and OverflowError.
    """
    names = tuple(table["name"])
    if not all(isinstance(name, str) for name in names):
        raise ValueError("a lane's name is no text")
    in_junction = np.zeros(len(names), dtype=np.bool_)
    in_junction[_integers(table["in_junction"])] = True
    columns: dict[str, Any] = {name: np.array(table[name], dtype=np.float64) for name in FLOATS}
    columns |= {name: _integers(table[name]) for name in INTEGERS}
    points = np.array(table["xy"], dtype=np.float64).reshape(-1, 2)
    control = None if "control" not in table else _control_of(table["control"])
    graph = LaneGraph(name=names, xy=points, in_junction=in_junction, control=control, **columns)
    problem = graph_problem(graph)
    if problem:
        raise ValueError(problem)
    return graph


def _control_of(table: Mapping[str, Any]) -> LinkControl:
    names = tuple(table["signal_name"])
    if not all(isinstance(name, str) for name in names):
        raise ValueError("a signal's name is no text")
    return LinkControl(signal_name=names, **{name: _integers(table[name]) for name in CONTROL_INTEGERS})


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
