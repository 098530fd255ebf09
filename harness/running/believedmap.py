"""The map that trackers are given, which may differ from the true road."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

from harness.common.errors import InputError
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map
from mmpf.map.road import Lane, Road

ONLY_LANE = 1


def believed_map(road: Road, told: Literal["one-lane", "none"]) -> Road:
    """Return the road as trackers are given it: without lanes, or with one as wide as all.

    Raises:
        InputError: The road has no lanes of one direction that could be one.
    """
    if told == "none":
        return LaneGraphRoad(without_map(), road.section_m, None, road.reference_xy, road.reference_start_m)
    if not isinstance(road, CorridorRoad):
        raise InputError(
            "`tracker.believes.map` one-lane: it is for networks with a main road, such as us101; leave it out, or set "
            "map to none"
        )
    return replace(road, lanes=_as_one(road.lanes)) if road.lanes else road


def _as_one(lanes: tuple[Lane, ...]) -> tuple[Lane, ...]:
    """Return one lane over all that go as far as any, auxiliary ones left out."""
    start, end = min(lane.start_m for lane in lanes), max(lane.end_m for lane in lanes)
    whole = [lane for lane in lanes if (lane.start_m, lane.end_m) == (start, end)] or list(lanes)
    right, left = min(lane.right_m for lane in whole), max(lane.left_m for lane in whole)
    return (Lane(ONLY_LANE, right, left, start, end),)
