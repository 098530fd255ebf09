"""Any SUMO network in the plane: its lanes as a graph of lines, with paths across junctions, and its buildings."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely

from harness.common.errors import InputError
from harness.common.untrusted_files import reading
from harness.truth.network.corridor import SumoEdge, SumoLane, SumoNet, read_net
from harness.truth.network.demand import Demand, Drivers, demand_for_density
from harness.truth.network.linkcontrol import read_control
from harness.truth.network.polyline import beside, followers, grid_origin, length_of
from mmpf.map.graph_road import LaneGraphRoad
from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.map.limits import graph_problem
from mmpf.numerics.arrays import BoolArray, FloatArray, IntArray

# Whoever drives on roads; lanes of which rails, feet or bicycles alone have the use are none of the graph's.
ROAD_VEHICLES = frozenset(
    {
        *("passenger", "taxi", "bus", "coach", "delivery", "truck", "trailer", "motorcycle", "evehicle", "hov"),
        *("private", "custom1", "custom2"),
    }
)
SAME_POINT_M = 0.01
# A shorter lane is none that a vehicle can be on: its neighbours along the way are linked past it.
SHORTEST_LANE_M = 0.1
# Long pieces are divided, since the squares of the plane that a piece may be in are those of its bounding box.
LONGEST_PIECE_M = 100.0
DECIMALS = 3
NEAR_BOTH_ENDS = np.array([0.1, 0.5, 0.9])
# Types of polygons, as netconvert and polyconvert write them, that stand up from the ground.
OPAQUE = ("building", "wall", "barrier.wall")
MOST_WALLS = 200_000


@dataclass(frozen=True)
class PlaneNetwork:
    """A network's lanes, and where their plane lies in SUMO's.

    Attributes:
        origin_xy: SUMO's coordinates of the plane's origin, whole kilometres, so that places stay small numbers.
        in_roundabout: Which lanes are of a roundabout's ring or cross one of its junctions, shape (lanes,); None if the
            network tells of no roundabout.
    """

    main_lanes = 0
    graph: LaneGraph
    origin_xy: tuple[float, float]
    in_roundabout: BoolArray | None = None

    @property
    def lanes_m(self) -> float:
        """Length of all lanes together, paths across junctions left out, metres."""
        return float(self.graph.length_m[~self.graph.in_junction].sum())

    @property
    def extent_m(self) -> tuple[float, float]:
        """From where to where its lanes reach along x, metres; a metre at least."""
        low, high = self.graph.xy[:, 0].min(), self.graph.xy[:, 0].max()
        return float(low), float(max(high, low + 1.0))

    def road(self, section_m: tuple[float, float], additional_files: Iterable[Path] = ()) -> LaneGraphRoad:
        """Return the lanes as a road, with the buildings of SUMO's additional files."""
        walls = read_walls(additional_files)
        return LaneGraphRoad(self.graph, section_m, None if walls is None else walls - np.tile(self.origin_xy, 2))

    def length_m(self, section_m: tuple[float, float]) -> float:  # noqa: ARG002  (of all that has a section)
        """Return the length of all lanes."""
        return self.lanes_m

    def demand(self, density_veh_per_km_lane: float, drivers: Drivers) -> Demand:  # noqa: ARG002
        """Return a density as a demand: there are neither ramps nor waves."""
        demand = demand_for_density(density_veh_per_km_lane)
        return Demand(demand.density_veh_per_km_lane, 0.0, 0.0, 0.0, 0.0, demand.wave_period_s)


def read_lane_graph(path: Path) -> PlaneNetwork:
    """Read the lanes of a network file that road vehicles may use.

    Raises:
        InputError: The file is no SUMO network, has no such lane, or is larger than can be driven on.
    """
    net = read_net(path, with_internal=True)
    with reading(path, "network whose lanes make sense"):
        edges = net.getEdges(withInternal=True)
        lanes = {lane.getID(): lane for edge in edges for lane in edge.getLanes()}
        lines = {name: _line(lane) for name, lane in lanes.items() if _for_road_vehicles(lane)}
        lines = {name: line for name, line in lines.items() if length_of(line) >= SHORTEST_LANE_M}
        if not lines:
            raise InputError(f"{path}: no lane of it is for road vehicles; give a network with roads")
        graph, origin = _assemble(lanes, lines)
        in_roundabout = _in_roundabouts(net, [lanes[name] for name in graph.name])
    problem = graph_problem(graph)
    if problem:
        raise InputError(f"{path}: {problem}; cut out the part that is driven on")
    return PlaneNetwork(graph, origin, in_roundabout)


def _in_roundabouts(net: SumoNet, lanes: Sequence[SumoLane]) -> BoolArray | None:
    edges = {edge for roundabout in net.getRoundabouts() for edge in roundabout.getEdges()}
    nodes = {node for roundabout in net.getRoundabouts() for node in roundabout.getNodes()}
    if not edges:
        return None
    # A path across a junction is called after it: `:JUNCTION_path_lane`.
    names = [(lane.getEdge().getID(), lane.getID()) for lane in lanes]
    return np.array([edge in edges or lane[1:].rsplit("_", 2)[0] in nodes for edge, lane in names])


def _assemble(lanes: dict[str, SumoLane], lines: dict[str, FloatArray]) -> tuple[LaneGraph, tuple[float, float]]:
    names = tuple(lines)
    index = {name: k for k, name in enumerate(names)}
    origin = grid_origin(np.min([line.min(axis=0) for line in lines.values()], axis=0))
    divided = shapely.segmentize([shapely.LineString(line - origin) for line in lines.values()], LONGEST_PIECE_M)
    placed = [np.round(shapely.get_coordinates(line), DECIMALS) for line in divided]
    follow = [followers(name, index, partial(_after, lanes)) for name in names]
    successor = np.array([to for each in follow for to in each], dtype=np.int64)
    first_successor = np.cumsum([0, *map(len, follow)])
    left, right = _neighbours([lanes[name].getEdge() for name in names], index, lines)
    chosen = [lanes[name] for name in names]
    graph = LaneGraph(
        name=names,
        xy=np.concatenate(placed),
        first_point=np.cumsum([0, *map(len, placed)]),
        width_m=np.array([float(lane.getWidth()) for lane in chosen]),
        speed_limit_mps=np.array([float(lane.getSpeed()) for lane in chosen]),
        left=left,
        right=right,
        successor=successor,
        first_successor=first_successor,
        in_junction=np.array([name.startswith(":") for name in names]),
        control=read_control(lanes, names, successor, first_successor),
    )
    return graph, (float(origin[0]), float(origin[1]))


def _for_road_vehicles(lane: SumoLane) -> bool:
    return not ROAD_VEHICLES.isdisjoint(lane.getPermissions())


def _line(lane: SumoLane) -> FloatArray:
    """Return a lane's middle line without repeated points, shape (p, 2); one point of a lane without length."""
    points = np.asarray(lane.getShape(), dtype=np.float64)[:, :2]
    return np.asarray(points[np.append(True, np.hypot(*np.diff(points, axis=0).T) > SAME_POINT_M)])


def _after(lanes: dict[str, SumoLane], name: str) -> Iterator[str]:
    """Yield the lanes that follow one and that whoever may use it would find too short if the graph lacks them."""
    for connection in lanes[name].getOutgoing():
        via = connection.getViaLaneID()
        following = via if via in lanes else connection.getToLane().getID()
        if _for_road_vehicles(lanes[following]):
            yield following


def _neighbours(
    edges: list[SumoEdge], index: dict[str, int], lines: dict[str, FloatArray]
) -> tuple[IntArray, IntArray]:
    """Return the lanes to the left and right of each, by where they lie: SUMO counts otherwise on the left."""
    left, right = np.full(len(index), NOWHERE), np.full(len(index), NOWHERE)
    for edge in {edge.getID(): edge for edge in edges}.values():
        for one, other in pairwise(edge.getLanes()):
            a, b = index.get(one.getID()), index.get(other.getID())
            if a is None or b is None:
                continue
            _, aside = beside(lines[one.getID()], lines[other.getID()], NEAR_BOTH_ENDS)
            apart = 0.5 * (one.getWidth() + other.getWidth())
            if 0.6 * apart <= np.abs(aside).min() and np.abs(aside).max() <= apart + 2.0:
                lower, upper = (a, b) if aside.mean() > 0.0 else (b, a)
                left[lower], right[upper] = upper, lower
    return left, right


def read_walls(files: Iterable[Path]) -> FloatArray | None:
    """Return the outlines of the buildings in additional files as rows of x and y of either end, metres, (w, 4).

    Heights are not known and play no part: a building hides whatever is behind it.

    Args:
        files: SUMO's additional files; those without polygons add nothing.

    Returns:
        The walls; None if there are none.

    Raises:
        InputError: A file can't be read, or there are more walls than any network needs.
    """
    from sumolib.shapes import polygon  # noqa: PLC0415  (heavy)

    walls: list[FloatArray] = []
    for file in files:
        with reading(file, "file of polygons"):
            found = polygon.read(str(file))
        opaque = [each for each in found if str(each.type).startswith(OPAQUE) and len(each.shape) > 1]
        if degrees := [each.id for each in opaque if each.geo not in (None, "0", "false")]:
            raise InputError(f"{file}: the shape of poly {degrees[0][:60]} is in degrees (geo): give it in metres")
        walls.extend(_outline(np.asarray(each.shape, dtype=np.float64)[:, :2]) for each in opaque)
    if not walls:
        return None
    rows = np.concatenate(walls)
    if len(rows) > MOST_WALLS:
        raise InputError(f"the network's polygons have {len(rows)} walls; at most {MOST_WALLS} are taken")
    return rows


def _outline(corners: FloatArray) -> FloatArray:
    """Return the sides of a polygon, shape (k, 4), the one that closes it too; without those of no length."""
    sides = np.concatenate([corners, np.roll(corners, -1, axis=0)], axis=1)
    return np.asarray(sides[np.hypot(sides[:, 2] - sides[:, 0], sides[:, 3] - sides[:, 1]) > 1e-6])
