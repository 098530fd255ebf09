"""The ego's route over a lane graph, up to the first signal: beliefs hold no signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmpf.map.control import SIGNAL
from mmpf.map.lane_graph import NOWHERE, LaneGraph

MOST_PATHS = 4
"""So many paths across a junction may follow each other."""
FARTHEST_M = 1000.0


@dataclass(frozen=True)
class EgoRoute:
    """Consecutive lanes from the ego's own lane on: their indices and lengths."""

    lanes: tuple[int, ...]
    length_m: tuple[float, ...]

    def left_m(self, graph: LaneGraph, lane: int, lon_m: float, lat_m: float) -> float:
        """Return how far a place on one of its lanes is from the way's end, metres; 0 off the way."""
        if lane not in self.lanes:
            return 0.0
        place = self.lanes.index(lane)
        along_m = graph.on_lane(np.array([lane]), np.array([lon_m]), np.array([lat_m]))[0]
        return float(sum(self.length_m[place:]) - along_m[0])


def way_of(graph: LaneGraph, lane: int, edges: Sequence[str]) -> EgoRoute:
    """Return the way from a lane on by a route's edges, that of the lane first."""
    lanes, ahead_m = [lane], float(graph.length_m[lane])
    for edge in edges[1:]:
        path = _path_to(graph, lanes[-1], edge)
        if path is None or ahead_m > FARTHEST_M:
            break
        lanes += path
        ahead_m += float(sum(graph.length_m[number] for number in path))
    return EgoRoute(tuple(lanes), tuple(float(graph.length_m[number]) for number in lanes))


def edge_of(graph: LaneGraph, lane: int) -> str:
    """Return the name of a lane's edge; SUMO's lanes are called after theirs."""
    return graph.name[lane].rpartition("_")[0]


def _path_to(graph: LaneGraph, lane: int, edge: str, paths: int = MOST_PATHS) -> list[int] | None:
    """Return the lanes after a lane up to an edge by links without signals; None where there are none."""
    for link in range(int(graph.first_successor[lane]), int(graph.first_successor[lane + 1])):
        following = int(graph.successor[link])
        if following == NOWHERE or (graph.control is not None and graph.control.kind[link] == SIGNAL):
            continue
        if edge_of(graph, following) == edge:
            return [following]
        if paths and graph.in_junction[following]:
            rest = _path_to(graph, following, edge, paths - 1)
            if rest is not None:
                return [following, *rest]
    return None
