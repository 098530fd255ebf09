"""The lanes of a graph that recorded vehicles used: the likeliest connected sequence.

Where lanes cross or part several lie under a vehicle, and the nearest one changes from step to step. The sequence that
fits all of a vehicle's places and directions best, without jumps between lanes that don't meet, is found by dynamic
programming (Viterbi 1967).
"""

import numpy as np

from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray, wrapped

# Standard deviations of a place beside its lane's middle and of a direction against the lane's.
BESIDE_STD_M, ASTRAY_STD_RAD = 1.0, np.deg2rad(15.0)
# A vehicle farther beside a lane's edge, or pointing farther away from its direction, is not on it.
BEYOND_EDGE_M, ASTRAY_RAD = 1.0, np.deg2rad(75.0)
# Costs beside half a squared deviation: to be on no lane at all, to change lanes, to jump to one that does not meet.
OFF_ROAD, CHANGE, JUMP = 12.0, 4.0, 15.0


def lanes_driven(graph: LaneGraph, stay: IntArray, x: FloatArray, y: FloatArray, heading_rad: FloatArray) -> IntArray:
    """Return the lane that each row's vehicle is on, ``NOWHERE`` off the road, shape (n,).

    Args:
        graph: The lanes.
        stay: Stay of each row; its rows are in the order of time, shape (n,).
        x: Places in the plane, metres, shape (n,).
        y: The same.
        heading_rad: Where vehicles point, shape (n,).
    """
    near = graph.lanes_near(x, y, most=8)
    off = np.abs(wrapped(near.heading_rad - heading_rad[:, None]))
    cost = 0.5 * (near.left_m / BESIDE_STD_M) ** 2 + 0.5 * (off / ASTRAY_STD_RAD) ** 2
    beyond = np.abs(near.left_m) > 0.5 * graph.width_m[near.lane] + BEYOND_EDGE_M
    cost[(near.lane == NOWHERE) | beyond | (off > ASTRAY_RAD)] = np.inf
    lane = np.concatenate([near.lane, np.full((len(stay), 1), NOWHERE)], axis=1)
    cost = np.concatenate([cost, np.full((len(stay), 1), OFF_ROAD)], axis=1)
    follows = _follows(graph)
    found = np.full(len(stay), NOWHERE)
    for one in np.unique(stay):
        own = np.flatnonzero(stay == one)
        found[own] = _likeliest(lane[own], cost[own], graph, follows)
    return found


def _follows(graph: LaneGraph) -> BoolArray:
    """Return whether one lane leads to another, directly or past one between, shape (lanes, lanes)."""
    follows = np.zeros((len(graph), len(graph)), dtype=np.bool_)
    follows[graph.link_from, graph.successor] = True
    # A short lane may be passed between two steps.
    return follows | (follows.astype(np.float32) @ follows.astype(np.float32) > 0.0)


def _likeliest(lane: IntArray, cost: FloatArray, graph: LaneGraph, follows: BoolArray) -> IntArray:
    """Return the cheapest sequence of one vehicle's lanes, shape (t,), of candidates and their costs, each (t, k)."""
    total = cost[0].copy()
    came_from = np.zeros(lane.shape, dtype=np.int64)
    for t in range(1, len(lane)):
        through = total[:, None] + _transition(lane[t - 1], lane[t], graph, follows)
        came_from[t] = through.argmin(axis=0)
        total = through.min(axis=0) + cost[t]
    best = np.empty(len(lane), dtype=np.int64)
    best[-1] = total.argmin()
    for t in range(len(lane) - 1, 0, -1):
        best[t - 1] = came_from[t, best[t]]
    return lane[np.arange(len(lane)), best]


def _transition(before: IntArray, after: IntArray, graph: LaneGraph, follows: BoolArray) -> FloatArray:
    """Return what it costs to come from each of one step's lanes to each of the next one's, shape (k, k)."""
    one, other = before[:, None], after[None, :]
    beside = (graph.left[one] == other) | (graph.right[one] == other)
    cost = np.where(beside, CHANGE, JUMP)
    cost[follows[one, other] | (one == other)] = 0.0
    # Leaving the road and coming back to it costs as much as a change of lanes.
    cost[(one == NOWHERE) ^ (other == NOWHERE)] = CHANGE
    cost[(one == NOWHERE) & (other == NOWHERE)] = 0.0
    return np.asarray(cost)
