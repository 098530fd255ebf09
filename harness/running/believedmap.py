"""The map that trackers are given, which may differ from the true road."""

from __future__ import annotations

from dataclasses import replace

from harness.common.errors import InputError
from harness.config.model import BeliefsConfig
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import without_map
from mmpf.map.road import Lane, Road

ONLY_LANE = 1


def believed_map(road: Road, believes: BeliefsConfig) -> Road:
    """Return the road as trackers are given it.

    Raises:
        InputError: The road has no such lane, or has no lanes of one direction that could be one.
    """
    if believes.map == "none":
        return LaneGraphRoad(without_map(), road.section_m, None, road.reference_xy, road.reference_start_m)
    missing, as_one = set(believes.lanes_left_out or ()), believes.map == "one-lane"
    if missing or as_one:
        road = _with_other_lanes(road, missing, as_one)
    return road.shifted(believes.map_shift_m) if believes.map_shift_m else road


def _with_other_lanes(road: Road, missing: set[int], as_one: bool) -> Road:
    if not isinstance(road, CorridorRoad):
        raise InputError(
            "`tracker.believes`: one-lane and lanes_left_out are for networks with a main road, such as us101; "
            "leave them out, or set map to none"
        )
    if missing - {lane.number for lane in road.lanes}:
        known = ", ".join(sorted({str(lane.number) for lane in road.lanes}))
        raise InputError(f"`tracker.believes.lanes_left_out`: the road has the lanes {known}; choose among them")
    lanes = tuple(lane for lane in road.lanes if lane.number not in missing)
    return replace(road, lanes=_as_one(lanes) if as_one and lanes else lanes)


def _as_one(lanes: tuple[Lane, ...]) -> tuple[Lane, ...]:
    """Return one lane over all that go as far as any, auxiliary ones left out."""
    start, end = min(lane.start_m for lane in lanes), max(lane.end_m for lane in lanes)
    whole = [lane for lane in lanes if (lane.start_m, lane.end_m) == (start, end)] or list(lanes)
    right, left = min(lane.right_m for lane in whole), max(lane.left_m for lane in whole)
    return (Lane(ONLY_LANE, right, left, start, end),)
