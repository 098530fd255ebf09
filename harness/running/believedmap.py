"""The map that trackers are told of, apart from the road that there is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from harness.common.errors import InputError
from harness.config.model import BeliefsConfig
from mmpf.map.lane_graph import LaneGraph, without_map
from mmpf.map.road import Lane, Road

ONLY_LANE = 1


def believed_map(road: Road, believes: BeliefsConfig) -> Road:
    """Return the road as trackers are told it.

    Args:
        road: What there is.
        believes: What they are told instead.

    Raises:
        InputError: The road has no such lane, or has no lanes of one direction that could be one.
    """
    if believes.map == "none":
        return replace(road, lanes=(), graph=without_map(), walls_xy=None)
    graph, missing = road.graph, set(believes.lanes_left_out or ())
    if graph is not None and (missing or believes.map == "one-lane"):
        raise InputError(
            "`tracker.believes`: one-lane and lanes_left_out are for networks with a main road, such as us101; "
            "leave them out, or set map to none"
        )
    if missing - {lane.number for lane in road.lanes}:
        known = ", ".join(sorted({str(lane.number) for lane in road.lanes}))
        raise InputError(f"`tracker.believes.lanes_left_out`: the road has the lanes {known}; choose among them")
    lanes = tuple(lane for lane in road.lanes if lane.number not in missing)
    if believes.map == "one-lane" and lanes:
        lanes = _as_one(lanes)
    shift = believes.map_shift_m or 0.0
    if shift:
        lanes = tuple(replace(lane, right_m=lane.right_m + shift, left_m=lane.left_m + shift) for lane in lanes)
        graph = None if graph is None else _shifted(graph, shift)
    return replace(road, lanes=lanes, graph=graph)


def _as_one(lanes: tuple[Lane, ...]) -> tuple[Lane, ...]:
    """Return one lane over all that go as far as any, auxiliary ones left out."""
    start, end = min(lane.start_m for lane in lanes), max(lane.end_m for lane in lanes)
    whole = [lane for lane in lanes if (lane.start_m, lane.end_m) == (start, end)] or list(lanes)
    right, left = min(lane.right_m for lane in whole), max(lane.left_m for lane in whole)
    return (Lane(ONLY_LANE, right, left, start, end),)


def _shifted(graph: LaneGraph, shift_m: float) -> LaneGraph:
    """Return a graph whose lanes all lie so far towards the north."""
    return replace(graph, xy=graph.xy + np.array([0.0, shift_m]))
