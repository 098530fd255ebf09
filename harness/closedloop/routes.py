"""The ego's route: on a main road, or over a lane graph up to the first signal, since beliefs hold no signals."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np

from harness.closedloop.passing import Passage
from harness.scoring.metrics.closedloop import OFF_THE_ROAD, WAY_ENDED
from harness.truth.frame import Frame
from mmpf.map.control import SIGNAL
from mmpf.map.lane_graph import NOWHERE, LaneGraph

MOST_PATHS = 4
"""So many paths across a junction may follow each other."""
FARTHEST_M = 1000.0
# As far as the road is known beyond the section, less what a driver looks ahead.
BEYOND_SECTION_M = 30.0
STOP_LINE_M = 1.0


class EgoRoute(Protocol):
    """Where the ego drives in an episode."""

    @property
    def lanes(self) -> tuple[int, ...]:
        """Indices of the lanes of a graph that it goes by, its own first; none on a main road."""

    @property
    def ended(self) -> str:
        """How an episode ends whose ego comes to the route's end."""

    def is_at_end(self, frame: Frame) -> bool:
        """Return whether the ego of a frame is at the end."""

    def passage(self, step_s: float, heed: float | None) -> Passage | None:
        """Return how the ego passes places where it must yield, see ``Passage``; None where it drives by its lane."""


@dataclass(frozen=True)
class MainRoadRoute:
    """A main road up to the end of its section, metres; see ``EgoRoute``."""

    end_m: float = np.inf
    lanes: ClassVar[tuple[int, ...]] = ()
    ended: ClassVar[str] = OFF_THE_ROAD

    def is_at_end(self, frame: Frame) -> bool:
        """Return whether the road ends soon."""
        return float(frame.lon_m[frame.ego]) > self.end_m + BEYOND_SECTION_M

    def passage(self, step_s: float, heed: float | None) -> None:
        """Return None: nobody yields on a main road."""


@dataclass(frozen=True)
class LaneRoute:
    """Consecutive lanes of a graph from the ego's own lane on, and their lengths; see ``EgoRoute``."""

    graph: LaneGraph
    lanes: tuple[int, ...]
    length_m: tuple[float, ...]
    ended: ClassVar[str] = WAY_ENDED

    def is_at_end(self, frame: Frame) -> bool:
        """Return whether the route ends soon, where the ego would have to stop or give way."""
        return self.left_m(frame, frame.ego) < STOP_LINE_M + 0.5 * float(frame.length_m[frame.ego])

    def passage(self, step_s: float, heed: float | None) -> Passage:
        """Return the passage over the lanes."""
        return Passage.over(self.graph, self.lanes, step_s, heed)

    def left_m(self, frame: Frame, row: int) -> float:
        """Return how far a vehicle on one of the lanes is from the route's end, metres; 0 off the route."""
        lane = int(frame.lane[row]) - 1
        if lane not in self.lanes:
            return 0.0
        place = self.lanes.index(lane)
        along_m, _, _ = self.graph.on_lane(np.array([lane]), frame.lon_m[[row]], frame.lat_m[[row]])
        return float(sum(self.length_m[place:]) - along_m[0])


def route_of(graph: LaneGraph, lane: int, edges: Sequence[str]) -> LaneRoute:
    """Return the route from a lane on by a route's edges, that of the lane first."""
    lanes, ahead_m = [lane], float(graph.length_m[lane])
    for edge in edges[1:]:
        path = _path_to(graph, lanes[-1], edge)
        if path is None or ahead_m > FARTHEST_M:
            break
        lanes += path
        ahead_m += float(sum(graph.length_m[number] for number in path))
    return LaneRoute(graph, tuple(lanes), tuple(float(graph.length_m[number]) for number in lanes))


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
