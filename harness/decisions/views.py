"""The lanes around the ego: its own and the adjacent ones, with each vehicle's distance along and across them."""

from dataclasses import dataclass, replace
from functools import singledispatch

import numpy as np

from harness.decisions.bodies import Bodies, Egos
from harness.decisions.routes import route_lines
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.road import Lane, Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

OWN, LEFT, RIGHT = range(3)
HORIZON_M = 120.0
"""Farther vehicles matter to no driver."""
# Off every lane a driver goes straight on in a lane of this half width.
HALF_WIDTH_OFF_ROAD_M = 1.8
# Lines of two lanes that lie nearer to each other are one line.
SAME_LINE_M = 0.5


@dataclass(frozen=True)
class LaneView:
    """One lane seen from the ego at each of n steps, with m bodies projected on it.

    Attributes:
        exists: Whether there is such a lane beside the ego, shape (n,).
        half_width_m: From its middle to its lines, shape (n,).
        ego_across_m: How far left of its middle the ego is, shape (n,).
        along_m: How far ahead of the ego's centre each body's is, nan of one that is not near it, shape (m,).
        across_m: How far left of the lane's middle it is, shape (m,).
        speed_mps: Its speed along the lane, shape (m,).
    """

    exists: BoolArray
    half_width_m: FloatArray
    ego_across_m: FloatArray
    along_m: FloatArray
    across_m: FloatArray
    speed_mps: FloatArray


@singledispatch
def lane_views(road: Road, egos: Egos, bodies: Bodies) -> tuple[LaneView, LaneView, LaneView]:
    """Return the ego's own lane, that to its left and that to its right.

    On a graph of lanes the own lane goes on along the route that the ego takes, which its driver knows.
    """
    raise NotImplementedError(type(road))


@lane_views.register
def _(road: LaneGraphRoad, egos: Egos, bodies: Bodies) -> tuple[LaneView, LaneView, LaneView]:
    views = []
    for route in route_lines(egos, road.graph):
        placed = route.place(egos, bodies, HORIZON_M)
        views.append(LaneView(route.exists, route.half_width_m, route.ego_across_m, *placed))
    return views[OWN], views[LEFT], views[RIGHT]


@lane_views.register
def _(road: CorridorRoad, egos: Egos, bodies: Bodies) -> tuple[LaneView, LaneView, LaneView]:
    numbers = np.array([lane.number for lane in road.lanes], dtype=np.int64)
    own = np.full(len(egos), -1)
    for place, number in enumerate(numbers):
        # Two lanes of one number follow each other along the road.
        lane = road.lanes[place]
        own[(egos.lane == number) & (egos.lon_m >= lane.start_m) & (egos.lon_m < lane.end_m)] = place
    off = own < 0
    centre = np.append([lane.centre_m for lane in road.lanes], np.nan)
    half = np.append([0.5 * (lane.left_m - lane.right_m) for lane in road.lanes], np.nan)

    def view(index: IntArray) -> LaneView:
        middle = np.where(off, egos.lat_m, centre[index])
        half_width = np.where(off, HALF_WIDTH_OFF_ROAD_M, half[index])
        return LaneView(
            exists=(index >= 0) | off,
            half_width_m=half_width,
            ego_across_m=egos.lat_m - middle,
            along_m=bodies.lon_m - egos.lon_m[bodies.step],
            across_m=bodies.lat_m - middle[bodies.step],
            speed_mps=bodies.speed_mps,
        )

    left, right = (_beside(own, egos.lon_m, road.lanes, to_left) for to_left in (True, False))
    own_view, *sides = (view(index) for index in (own, left, right))
    beside = [replace(side, exists=index >= 0) for index, side in zip((left, right), sides, strict=True)]
    return own_view, beside[0], beside[1]


def _beside(own: IntArray, lon_m: FloatArray, lanes: tuple[Lane, ...], to_left: bool) -> IntArray:
    """Return the index of the lane beside the own one at each place, -1 where there is none, shape (n,)."""
    found = np.full(len(own), -1)
    for index, lane in enumerate(lanes):
        line = lane.left_m if to_left else lane.right_m
        for other, candidate in enumerate(lanes):
            touches = abs((candidate.right_m if to_left else candidate.left_m) - line) < SAME_LINE_M
            if other != index and touches:
                found[(own == index) & (lon_m >= candidate.start_m) & (lon_m < candidate.end_m)] = other
    return found
