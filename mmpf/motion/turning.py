"""Speeds where roads bend and meet: limits for curves, turns and stop lines on the route."""

from dataclasses import dataclass
from functools import cache

import numpy as np

from mmpf.map.control import FREE, YIELD
from mmpf.map.lane_graph import NO_LIMIT_MPS, NOWHERE, LaneColumns, LaneGraph
from mmpf.motion.kinematic import committed_table
from mmpf.numerics.arrays import FloatArray, IntArray
from mmpf.numerics.kernels import kernel


@dataclass(frozen=True)
class TurningDriver:
    """How drivers drive by the map, as fitted to traffic where roads meet.

    Attributes:
        turning_mps2: Lateral acceleration in a turn.
        slowing_mps2: How hard they brake before a slower lane.
        looking_mps: How fast they come to a line where others have right of way.
        strongest_mps2: How hard they accelerate at most.
        pace: Their speed against the one that the road lets them go, on the average.
        pace_spread: Its standard deviation over drivers.
    """

    turning_mps2: float
    slowing_mps2: float
    looking_mps: float
    strongest_mps2: float
    pace: float
    pace_spread: float


@cache
def turning_driver() -> TurningDriver:
    """Return the driver that was fitted (``mmpf/models/turning.md``)."""
    return TurningDriver(**committed_table("turning.toml"))


def lane_speeds(graph: LaneGraph, driver: TurningDriver) -> FloatArray:
    """Return how fast each lane is driven, m/s, (l,): by its limit, and in turns across junctions by its bend.

    Infinite where neither is known, since a limit that nobody reaches says nothing of how fast a street is driven.
    """
    limit = np.where(graph.speed_limit_mps < NO_LIMIT_MPS, graph.speed_limit_mps, np.inf)
    with np.errstate(divide="ignore"):
        in_turn = np.sqrt(driver.turning_mps2 / graph.curvature_per_m)
    return np.where(graph.in_junction, np.minimum(limit, in_turn), limit)


def road_speeds(
    graph: LaneGraph, lane: IntArray, following: IntArray, along_m: FloatArray, driver: TurningDriver
) -> FloatArray:
    """Return how fast the road can be driven at each place, m/s, (n,); infinite off every lane.

    Towards a slower lane it falls as its driver brakes.

    Args:
        graph: The lanes.
        lane: Lane of each place, ``NOWHERE`` for none, shape (n,).
        following: The lane that is taken next, ``NOWHERE`` for none, shape (n,).
        along_m: Arc length along the lane, shape (n,).
        driver: Whose speeds they are.
    """
    kind = np.full(len(graph.successor), FREE) if graph.control is None else graph.control.kind
    speed, allowed = lane_speeds(graph, driver), np.full(len(lane), np.inf)
    looking = np.minimum(speed, driver.looking_mps)
    _slow_down(lane, following, along_m, speed, looking, driver.slowing_mps2, graph.columns, kind, allowed)
    return allowed


@kernel()
def _slow_down(
    lane: IntArray,
    following: IntArray,
    along: FloatArray,
    speed: FloatArray,
    looking_speed: FloatArray,
    slowing: float,
    lanes: LaneColumns,
    kind: IntArray,
    allowed: FloatArray,
) -> None:
    length, successor, first_successor = lanes.length_m, lanes.successor, lanes.first_successor
    for n in range(len(lane)):
        own, then = lane[n], following[n]
        if own == NOWHERE:
            continue
        allowed[n] = speed[own]
        if then == NOWHERE:
            continue
        ahead = speed[then]
        for k in range(first_successor[own], first_successor[own + 1]):
            if successor[k] == then and kind[k] == YIELD:
                ahead = looking_speed[then]
        left = max(length[own] - along[n], 0.0)
        allowed[n] = min(allowed[n], np.sqrt(ahead * ahead + 2.0 * slowing * left))
