"""Places all drives of a run in one plane, farther apart than any sensor's range."""

from collections.abc import Sequence

import numpy as np

from harness.truth.recorded.detected.recorded_drive import Drive
from harness.truth.recorded.laneletgraph import road_of_graph
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import NOWHERE, LaneGraph, without_map
from mmpf.map.road import Road
from mmpf.numerics.arrays import FloatArray, IntArray

APART_M = 1000.0


def laid_apart(drives: Sequence[Drive]) -> tuple[Drive, ...]:
    """Return drives shifted along x by whole kilometres, except the first; unchanged if none has a map."""
    if all(drive.lanes is None for drive in drives):
        return tuple(drives)
    placed: list[Drive] = []
    for drive in drives:
        x = _extent_x(drive)
        behind = _extent_x(placed[-1]).max() + APART_M - x.min() if placed else 0.0
        placed.append(drive.moved(APART_M * float(np.ceil(behind / APART_M))))
    return tuple(placed)


def road_of(drives: Sequence[Drive]) -> Road:
    """Return the lanes of all drives in their order; the plane without a map if none has any."""
    maps = [(drive.name, drive.lanes) for drive in drives if drive.lanes is not None]
    if not maps:
        return LaneGraphRoad(graph=without_map())
    return road_of_graph(maps[0][1] if len(maps) == 1 else _joined(maps))


def _extent_x(drive: Drive) -> FloatArray:
    lanes = np.zeros(0) if drive.lanes is None else drive.lanes.xy[:, 0]
    return np.concatenate([lanes, drive.ego.x_m, drive.labels.x_m, drive.given.x_m])


def _joined(maps: Sequence[tuple[str, LaneGraph]]) -> LaneGraph:
    graphs = [graph for _, graph in maps]
    before = np.cumsum([0, *map(len, graphs)])[:-1].tolist()
    return LaneGraph(
        # Maps of one city may share lanes.
        name=tuple(f"{name}/{lane}" for name, graph in maps for lane in graph.name),
        xy=np.concatenate([graph.xy for graph in graphs]),
        first_point=_starts([graph.first_point for graph in graphs]),
        width_m=np.concatenate([graph.width_m for graph in graphs]),
        speed_limit_mps=np.concatenate([graph.speed_limit_mps for graph in graphs]),
        left=np.concatenate([_counted_on(graph.left, first) for graph, first in zip(graphs, before, strict=True)]),
        right=np.concatenate([_counted_on(graph.right, first) for graph, first in zip(graphs, before, strict=True)]),
        successor=np.concatenate([graph.successor + first for graph, first in zip(graphs, before, strict=True)]),
        first_successor=_starts([graph.first_successor for graph in graphs]),
        in_junction=np.concatenate([graph.in_junction for graph in graphs]),
    )


def _counted_on(lane: IntArray, first: int) -> IntArray:
    return np.where(lane == NOWHERE, NOWHERE, lane + first)


def _starts(starts: Sequence[IntArray]) -> IntArray:
    return np.concatenate([[0], np.cumsum(np.concatenate([np.diff(each) for each in starts]))]).astype(np.int64)
