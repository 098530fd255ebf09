"""Drivers on a map without a leader: the place of each on its lane, and the lane it took next."""

from dataclasses import dataclass

import numpy as np

from harness.lab.windows.recording import Recording
from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

# A leader farther ahead than this, and this long, holds nobody.
HOLDS_WITHIN_M, HOLDS_WITHIN_S = 20.0, 3.0


@dataclass(frozen=True)
class OnMap:
    """Moments of vehicles on lanes, sorted by vehicle and step; arrays of shape (n,).

    Attributes:
        following: The lane that it took next, ``NOWHERE`` if none is on record.
        to_end_m: What is left of it.
        leaves_at_mps: Its speed at its last moment on this lane.
        free: Whether no leader holds it, on its lane or on the two that it took next.
    """

    driver: IntArray
    lane: IntArray
    following: IntArray
    along_m: FloatArray
    to_end_m: FloatArray
    speed_mps: FloatArray
    accel_mps2: FloatArray
    leaves_at_mps: FloatArray
    free: BoolArray

    def __len__(self) -> int:
        return len(self.lane)


def on_map(recording: Recording, graph: LaneGraph) -> OnMap:
    """Lay recorded traffic onto the lanes of the map that it was recorded on.

    Args:
        recording: Traffic whose positions are x and y, and whose lanes are numbered from 1 as in the graph.
    """
    order = np.lexsort((recording.step, recording.vehicle))
    order = order[recording.lane[order] > 0]
    lane, vehicle, step = recording.lane[order] - 1, recording.vehicle[order], recording.step[order]
    along, _, _ = graph.on_lane(lane, recording.lon_m[order], recording.lat_m[order])
    # The number of each row's stay on one lane, and the first row of each stay.
    begins = np.ones(len(lane), dtype=np.bool_)
    begins[1:] = (lane[1:] != lane[:-1]) | (vehicle[1:] != vehicle[:-1])
    stay, first = np.cumsum(begins) - 1, np.flatnonzero(begins)
    # The lane of each stay's next one where it follows in the graph.
    goes_on = vehicle[first[1:]] == vehicle[first[:-1]]
    then = np.append(np.where(goes_on, lane[first[1:]], NOWHERE), NOWHERE)
    links = set(zip(graph.link_from.tolist(), graph.successor.tolist(), strict=True))
    follows = [pair in links for pair in zip(lane[first].tolist(), then.tolist(), strict=True)]
    then = np.where(follows, then, NOWHERE)
    after = np.where(then == NOWHERE, NOWHERE, then[np.minimum(np.arange(len(then)) + 1, len(then) - 1)])
    last = np.append(first[1:], len(lane)) - 1
    speed, length = recording.speed_mps[order], recording.length_m[order]
    to_end = graph.length_m[lane] - along
    gap = _gap(step, lane, along, length, then[stay], after[stay], to_end, graph)
    return OnMap(
        driver=vehicle,
        lane=lane,
        following=then[stay],
        along_m=along,
        to_end_m=to_end,
        speed_mps=speed,
        accel_mps2=recording.accel_mps2[order],
        leaves_at_mps=speed[last[stay]],
        free=gap > HOLDS_WITHIN_M + HOLDS_WITHIN_S * speed,
    )


def _gap(
    step: IntArray,
    lane: IntArray,
    along: FloatArray,
    length: FloatArray,
    then: IntArray,
    after: IntArray,
    to_end: FloatArray,
    graph: LaneGraph,
) -> FloatArray:
    """Return the clear distance to the next vehicle on the own lane or the two that follow, infinite for none, (n,)."""
    order = np.lexsort((along, lane, step))
    place = step[order] * (len(graph) + 1) + lane[order]
    gap = np.full(len(lane), np.inf)
    same = place[1:] == place[:-1]
    ahead, behind = order[1:][same], order[:-1][same]
    gap[behind] = along[ahead] - along[behind] - 0.5 * (length[ahead] + length[behind])
    begins = np.flatnonzero(np.append(True, ~same))
    keys, heads = place[begins], order[begins]
    for lanes, away in ((then, to_end), (after, to_end + graph.length_m[then])):
        wanted = step * (len(graph) + 1) + lanes
        found = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
        there = (lanes != NOWHERE) & (keys[found] == wanted)
        head = heads[found]
        gap = np.where(there, np.minimum(gap, away + along[head] - 0.5 * (length + length[head])), gap)
    return gap
