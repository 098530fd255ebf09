"""The lanes of a road in short pieces, and the flow of traffic between pieces."""

from dataclasses import dataclass
from functools import singledispatch

import numpy as np

from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.road import Road
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

CELL_M = 5.0
CELLS_A_STRETCH = 5
# A lane without a beginning or end is cut this far outside of the section that is scored.
BEYOND_SECTION_M = 300.0


@dataclass(frozen=True)
class LaneCells:
    """Pieces of all lanes in driving direction, lane by lane; arrays of shape (n,).

    Attributes:
        lane: Number of the lane: on a road frame the lane's own, on a graph the index plus one.
        lon_m: Longitudinal position of the middle, metres, and ``lat_m`` its lateral one.
        heading_rad: Driving direction against the frame's longitudinal axis, radians.
        length_m: Length along the lane.
        share: Traffic of the lane over that of a lane that nothing divides: across a junction the ways share it.
        before_stop_m: From the middle to where a signal or right of way may hold vehicles, infinite where none does.
        entry: Whether traffic that comes from beyond the map begins here.
        stretch: Number of the stretch of 25 m, or what is left of its lane, that it belongs to, of ``in_stretch``
            cells.
    """

    lane: IntArray
    lon_m: FloatArray
    lat_m: FloatArray
    heading_rad: FloatArray
    length_m: FloatArray
    share: FloatArray
    before_stop_m: FloatArray
    entry: BoolArray
    stretch: IntArray
    in_stretch: IntArray

    def __len__(self) -> int:
        return len(self.lane)


@dataclass(frozen=True)
class Links:
    """Where traffic flows from cell to cell; arrays of shape (k,).

    Attributes:
        source: Cell that it flows out of.
        target: Cell that it flows into.
        share: Which share of it takes this link.
    """

    source: IntArray
    target: IntArray
    share: FloatArray


@singledispatch
def cells_of(road: Road) -> tuple[LaneCells, Links]:
    """Return the cells of a road and the links between them; none where no lanes are known."""
    raise TypeError(f"{type(road).__name__} is no kind of road that has cells")


@cells_of.register
def _(road: CorridorRoad) -> tuple[LaneCells, Links]:
    low_m, high_m = road.section_m[0] - BEYOND_SECTION_M, road.section_m[1] + BEYOND_SECTION_M
    spans = [(max(lane.start_m, low_m), min(lane.end_m, high_m)) for lane in road.lanes]
    kept = [(lane, *span) for lane, span in zip(road.lanes, spans, strict=True) if span[1] > span[0]]
    counts = np.array([_pieces(end - start) for _, start, end in kept], dtype=np.int64)
    of_lane, along, length = _divided(np.array([end - start for _, start, end in kept]), counts)
    first = np.concatenate([[0], np.cumsum(counts)])
    starts = np.array([start for _, start, _ in kept])
    source, target = _within_lanes(of_lane)
    entry = np.zeros(len(of_lane), dtype=np.bool_)
    entry[first[:-1]] = True
    cells = LaneCells(
        lane=np.array([lane.number for lane, _, _ in kept], dtype=np.int64)[of_lane],
        lon_m=starts[of_lane] + along,
        lat_m=np.array([lane.centre_m for lane, _, _ in kept])[of_lane],
        heading_rad=np.zeros(len(of_lane)),
        length_m=length,
        share=np.ones(len(of_lane)),
        before_stop_m=np.full(len(of_lane), np.inf),
        entry=entry,
        **_in_stretches(of_lane),
    )
    return cells, Links(source, target, np.ones(len(source)))


@cells_of.register
def _(road: LaneGraphRoad) -> tuple[LaneCells, Links]:
    graph = road.graph
    lengths = graph.length_m if graph.has_map else np.zeros(0)
    counts = np.array([_pieces(length) for length in lengths], dtype=np.int64)
    of_lane, along, length = _divided(lengths, counts)
    first, last = np.cumsum(counts) - counts, np.cumsum(counts) - 1
    ways = np.diff(graph.first_successor)
    source, target = _within_lanes(of_lane)
    links = range(len(graph.successor)) if graph.has_map else range(0)
    link_from, link_to = graph.link_from[links], graph.successor[links]
    across = np.bincount(link_to, 1.0 / ways[link_from], minlength=len(graph)) if len(links) else np.zeros(len(graph))
    # A map may end within a junction: to a path that no lane on it leads to traffic comes as to any lane.
    share = np.where(graph.in_junction & (across > 0.0), np.minimum(across, 1.0), 1.0)
    entered = np.zeros(len(graph), dtype=np.bool_)
    entered[link_to] = True
    entry = np.zeros(len(of_lane), dtype=np.bool_)
    entry[first[~entered[: len(counts)]]] = True
    x, y, heading = graph.place(of_lane, along, np.zeros(len(of_lane)))
    # Within junctions nobody queues.
    to_line_m = np.where(graph.in_junction, np.inf, graph.length_m)[of_lane] - along + graph.to_stop_line_m[of_lane]
    cells = LaneCells(
        lane=of_lane + 1,
        lon_m=x,
        lat_m=y,
        heading_rad=heading,
        length_m=length,
        share=share[of_lane],
        before_stop_m=to_line_m,
        entry=entry,
        **_in_stretches(of_lane),
    )
    return cells, Links(
        source=np.concatenate([source, last[link_from]]),
        target=np.concatenate([target, first[link_to]]),
        share=np.concatenate([np.ones(len(source)), 1.0 / ways[link_from]]),
    )


def _pieces(length_m: float) -> int:
    return max(int(np.ceil(length_m / CELL_M)), 1)


def _divided(lengths_m: FloatArray, counts: IntArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return lane, place of the middle along it and length of each cell, each (n,)."""
    of_lane = np.repeat(np.arange(len(counts)), counts)
    length = (lengths_m / np.maximum(counts, 1))[of_lane]
    number = np.arange(len(of_lane)) - (np.cumsum(counts) - counts)[of_lane]
    return of_lane, (number + 0.5) * length, length


def _within_lanes(of_lane: IntArray) -> tuple[IntArray, IntArray]:
    """Return the links from each cell to the next one of its lane."""
    same = np.flatnonzero(of_lane[1:] == of_lane[:-1])
    return same, same + 1


def _in_stretches(of_lane: IntArray) -> dict[str, IntArray]:
    """Return each cell's stretch and the stretch's number of cells, each (n,), by name."""
    begins = np.append(True, of_lane[1:] != of_lane[:-1])[: len(of_lane)]
    number = np.arange(len(of_lane))
    since = number - np.maximum.accumulate(np.where(begins, number, 0)) if len(of_lane) else number
    stretch = np.cumsum(since % CELLS_A_STRETCH == 0) - 1
    return {"stretch": stretch, "in_stretch": np.bincount(stretch)[stretch] if len(of_lane) else number}
