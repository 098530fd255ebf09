"""The main road of a SUMO network: its edges in order, and the road frame along them."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import InputError
from harness.common.untrusted_files import reading, require_file
from harness.truth.network.demand import Demand, Drivers, demand_for_density
from mmpf.map.corridor_road import CorridorRoad
from mmpf.map.road import Lane, Road
from mmpf.numerics.arrays import FloatArray

# sumolib carries no types.
SumoNet = Any
SumoEdge = Any
SumoLane = Any
SumoConnection = Any

STRAIGHT_WITHIN_M = 0.05
ABUTS_WITHIN_M = 1.0


@dataclass(frozen=True)
class CorridorEdge:
    """One edge of the main road.

    Attributes:
        start_m: Longitudinal position of its start.
        extra_lanes: How many of them, from the right, are no through lanes.
    """

    name: str
    start_m: float
    length_m: float
    lanes: int
    extra_lanes: int
    speed_limit_mps: float

    @property
    def end_m(self) -> float:
        """Longitudinal position of its end."""
        return self.start_m + self.length_m


@dataclass(frozen=True)
class Ramp:
    """An edge by which vehicles enter or leave the main road.

    Attributes:
        index: Index into the corridor's edges: the edge that an on-ramp leads to, that an off-ramp leaves from.
    """

    name: str
    index: int
    length_m: float
    speed_limit_mps: float


@dataclass(frozen=True)
class Corridor:
    """The main road.

    Attributes:
        edges: Its edges in driving order.
        main_lanes: Lanes that all edges have.
        reference_xy: Right edge line of the main lanes in SUMO's plane.
    """

    edges: tuple[CorridorEdge, ...]
    main_lanes: int
    lanes: tuple[Lane, ...]
    reference_xy: tuple[tuple[float, float], ...]

    def length_m(self, section_m: tuple[float, float]) -> float:
        """Return the length of a section."""
        return section_m[1] - section_m[0]

    def demand(self, density_veh_per_km_lane: float, drivers: Drivers) -> Demand:
        """Return the demand for a density, given drivers."""
        return demand_for_density(density_veh_per_km_lane, self.main_lanes, drivers)

    def road(self, section_m: tuple[float, float], additional_files: Iterable[Path] = ()) -> CorridorRoad:  # noqa: ARG002
        """Return the road frame with a scored section; buildings beside it do not count."""
        return CorridorRoad(
            lanes=self.lanes,
            reference_xy=self.reference_xy,
            reference_start_m=self.edges[0].start_m,
            section_m=section_m,
        )


def read_net(path: Path, with_internal: bool = False) -> SumoNet:
    """Read a network with sumolib.

    Raises:
        InputError: The file is missing or is no SUMO network.
    """
    import sumolib.net  # noqa: PLC0415  (heavy)

    require_file(path, f"{path.parent}: the network file")
    with reading(path, "SUMO network file"):
        net = sumolib.net.readNet(str(path), withInternal=with_internal)
        edges = net.getEdges(withInternal=False)
    if not edges:
        raise InputError(f"{path}: not a SUMO network file: it has no edges")
    return net


def corridor_from_net(net: SumoNet, names: Sequence[str], start_m: float) -> Corridor:
    """Lay the road frame along the edges ``names``, the first of which starts at ``start_m``.

    Raises:
        InputError: An edge is missing, or the edges do not follow one another.
    """
    for name in names:
        if not net.hasEdge(name):
            raise InputError(f"corridor edge {name} is not in the network")
    sumo_edges = [net.getEdge(name) for name in names]
    for edge, following in pairwise(sumo_edges):
        if following not in edge.getOutgoing():
            raise InputError(f"corridor edge {following.getID()} does not follow edge {edge.getID()} in the network")
    main_lanes = min(edge.getLaneNumber() for edge in sumo_edges)
    reference = _reference_line(sumo_edges, main_lanes)
    frame = CorridorRoad(lanes=(), reference_xy=tuple(map(tuple, reference.tolist())), reference_start_m=start_m)
    edges = tuple(_place(edge, frame, main_lanes) for edge in sumo_edges)
    return Corridor(
        edges=edges, main_lanes=main_lanes, lanes=_lanes(sumo_edges, edges, frame), reference_xy=frame.reference_xy
    )


def ramp_from_net(net: SumoNet, name: str, corridor: Corridor, entering: bool) -> Ramp:
    """Return a ramp and where it meets the corridor.

    Raises:
        InputError: The ramp is not in the network or does not touch the corridor.
    """
    if not net.hasEdge(name):
        raise InputError(f"ramp {name} is not an edge of the network")
    edge = net.getEdge(name)
    neighbours = {other.getID() for other in (edge.getOutgoing() if entering else edge.getIncoming())}
    for index, main in enumerate(corridor.edges):
        if main.name in neighbours:
            return Ramp(name=name, index=index, length_m=edge.getLength(), speed_limit_mps=edge.getSpeed())
    raise InputError(f"ramp {name} does not touch the corridor")


def _reference_line(sumo_edges: Sequence[SumoEdge], main_lanes: int) -> FloatArray:
    """Return the right edge of the rightmost main lane, counted from the left, as a polyline, shape (k, 2)."""
    points: list[FloatArray] = []
    for edge in sumo_edges:
        lane = edge.getLane(edge.getLaneNumber() - main_lanes)
        points.extend(_shift_right(np.asarray(lane.getShape())[:, :2], 0.5 * lane.getWidth()))
    kept = [points[0]]
    for point in points[1:]:
        if np.hypot(*(point - kept[-1])) > STRAIGHT_WITHIN_M:
            kept.append(point)
    return _without_collinear(np.array(kept))


def _shift_right(line: FloatArray, by_m: float) -> FloatArray:
    steps = np.diff(line, axis=0)
    directions = steps / np.hypot(steps[:, 0], steps[:, 1])[:, None]
    at_vertices = np.vstack([directions[:1], directions[:-1] + directions[1:], directions[-1:]])
    at_vertices /= np.hypot(at_vertices[:, 0], at_vertices[:, 1])[:, None]
    return line + by_m * np.column_stack([at_vertices[:, 1], -at_vertices[:, 0]])


def _without_collinear(line: FloatArray) -> FloatArray:
    kept = [0]
    for middle in range(1, len(line) - 1):
        chord = line[middle + 1] - line[kept[-1]]
        offset = line[middle] - line[kept[-1]]
        across = abs(chord[0] * offset[1] - chord[1] * offset[0]) / np.hypot(*chord)
        if across > STRAIGHT_WITHIN_M:
            kept.append(middle)
    return line[[*kept, len(line) - 1]]


def _place(edge: SumoEdge, frame: Road, main_lanes: int) -> CorridorEdge:
    start_x, start_y = edge.getLane(edge.getLaneNumber() - 1).getShape()[0][:2]
    start_m, _ = frame.to_road(np.array([start_x]), np.array([start_y]))
    return CorridorEdge(
        name=edge.getID(),
        start_m=float(round(start_m[0], 4)),
        length_m=edge.getLength(),
        lanes=edge.getLaneNumber(),
        extra_lanes=edge.getLaneNumber() - main_lanes,
        speed_limit_mps=edge.getSpeed(),
    )


def _lanes(sumo_edges: Sequence[SumoEdge], edges: Sequence[CorridorEdge], frame: Road) -> tuple[Lane, ...]:
    """Return the lanes of all edges in the road frame, joined where they continue from edge to edge."""
    strips: dict[int, list[Lane]] = {}
    for sumo_edge, edge in zip(sumo_edges, edges, strict=True):
        for index in range(edge.lanes):
            number = edge.lanes - index
            strip = _strip(sumo_edge.getLane(index), number, edge, frame)
            before = strips.setdefault(number, [])
            if before and _goes_on(before[-1], strip):
                before[-1] = Lane(number, before[-1].right_m, before[-1].left_m, before[-1].start_m, strip.end_m)
            else:
                before.append(strip)
    return tuple(strip for number in sorted(strips) for strip in strips[number])


def _strip(lane: SumoLane, number: int, edge: CorridorEdge, frame: Road) -> Lane:
    shape = np.asarray(lane.getShape())[:, :2]
    _, lateral = frame.to_road(shape[:, 0], shape[:, 1])
    centre_m = float(np.median(lateral))
    half_m = 0.5 * lane.getWidth()
    return Lane(number, round(centre_m - half_m, 3), round(centre_m + half_m, 3), edge.start_m, edge.end_m)


def _goes_on(before: Lane, strip: Lane) -> bool:
    abuts = abs(before.end_m - strip.start_m) < ABUTS_WITHIN_M + 30.0
    return abuts and abs(before.right_m - strip.right_m) < 0.3 and abs(before.left_m - strip.left_m) < 0.3
