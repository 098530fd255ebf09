"""Cars that can be the ego of an episode, on a main road or a lane graph, and which vehicle a provocation acts on."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import repeat
from typing import Protocol

import numpy as np

from harness.closedloop.approaches import hidden_with_right_of_way
from harness.closedloop.beliefs import believed_by_each, ego_of, true_bodies
from harness.closedloop.inview import CHANGES_LANE_MPS, FARTHEST_LEADER_M, leader_in_view, stands_ahead
from harness.closedloop.plan import BRAKE, CROSS, DARK, DRIVEN_S, STOPPED
from harness.closedloop.routes import EgoRoute, LaneRoute, MainRoadRoute, edge_of, route_of
from harness.closedloop.sight import hidden_after_sight
from harness.closedloop.traffic import LiveTraffic, with_ego
from harness.config.sensor import SensorSettings
from harness.decisions.belief import NOBODY, Belief, believe
from harness.truth.network.corridor import Corridor
from harness.truth.network.lanegraph import PlaneNetwork
from harness.truth.sumo.brokendown import BROKEN_DOWN, drawn_car
from harness.truth.sumo.corridor_traffic import CAR_LENGTH_M
from harness.truth.sumo.fill import Placement
from mmpf.map.control import YIELD
from mmpf.map.lane_graph import LaneGraph
from mmpf.numerics.arrays import BoolArray, IntArray

SECTION_MARGIN_M = 20.0
# An ego needs so much road as it covers in an episode at this speed at most.
ROOM_AT_MPS = 12.0
# On a graph of lanes an ego needs so many seconds of its route before the first signal.
FREE_ROUTE_S = 8.0
FARTHEST_HIDDEN_M = 70.0
STANDING = f"{BROKEN_DOWN}_ahead"
"""Name of the vehicle that stands in the ego's way."""
SLOWEST_MPS = 3.0
"""Whoever is slower does not brake in a way that matters."""


@dataclass(frozen=True)
class Concerned:
    """The vehicle that a provocation would act on; see ``EpisodeStart``."""

    provoked: str = ""
    seen_before: bool | None = None
    stands: Placement | None = None


class Candidates(Protocol):
    """Cars that can be the ego of an episode of one kind that starts at the present moment."""

    @property
    def possible(self) -> bool:
        """Whether there can ever be any on this road."""

    @property
    def routes(self) -> Mapping[int, EgoRoute]:
        """Where each would drive, by its row of the present frame, in the order of rows."""

    def concerned(self, rows: IntArray, rng: np.random.Generator) -> Iterator[Concerned]:
        """Return for each of some candidates, lazily, the vehicle that a provocation would act on."""


def candidates_of(traffic: LiveTraffic, kind: str, settings: SensorSettings, flow_mps: float | None) -> Candidates:
    """Return the candidates for a kind of episode; with ``flow_mps``, in traffic of that speed."""
    match traffic.network.layout:
        case PlaneNetwork(graph=graph):
            return OnLaneGraph(traffic, kind, settings, graph)
        case Corridor() as main_road:
            return OnMainRoad(traffic, kind, settings, main_road, flow_mps)


@dataclass(frozen=True)
class OnMainRoad:
    """Candidates that keep to a lane of a main road; see ``Candidates``."""

    traffic: LiveTraffic
    kind: str
    settings: SensorSettings
    main_road: Corridor
    flow_mps: float | None

    @property
    def possible(self) -> bool:
        """Whether the kind needs no right of way, of which there is none."""
        return self.kind != CROSS

    @cached_property
    def routes(self) -> Mapping[int, EgoRoute]:
        """The road's end for each car with a past that keeps to a main lane; see ``Candidates``."""
        now, network, sumo = self.traffic.frames[-1], self.traffic.network, self.traffic.running.sumo
        start_m, end_m = network.section_m
        room_m = DRIVEN_S * np.minimum(now.speed_mps, ROOM_AT_MPS)
        chosen = _driving_cars(self.traffic) & (now.lon_m > start_m + SECTION_MARGIN_M) & (now.lon_m + room_m < end_m)
        chosen &= np.isin(now.lane, np.asarray(network.ego_lanes)) & (np.abs(now.lat_speed_mps) <= CHANGES_LANE_MPS)
        last, route = self.main_road.edges[-1].name, MainRoadRoute(end_m)
        rows = np.flatnonzero(chosen).tolist()
        return {row: route for row in rows if sumo.vehicle.getRoute(str(now.vehicle_id[row]))[-1] == last}

    def concerned(self, rows: IntArray, rng: np.random.Generator) -> Iterator[Concerned]:
        """Return who leads each, or where a vehicle would stand in its way; see ``Candidates``."""
        traffic, settings = self.traffic, self.settings
        if self.kind == STOPPED:
            vehicle = drawn_car(traffic.network, rng)
            found = (stands_ahead(traffic, int(row), settings.range_m, vehicle, self.flow_mps) for row in rows)
            return (Concerned() if stands is None else Concerned(STANDING, stands=stands) for stands in found)
        if self.kind not in (BRAKE, DARK):
            return repeat(Concerned())
        belief = believed_by_each(traffic.frames[-1], rows, traffic.network.road)
        leader = hidden_second_leader if self.kind == BRAKE else leader_in_view
        return (Concerned(leader(traffic, belief, place, int(row), settings)) for place, row in enumerate(rows))


@dataclass(frozen=True)
class OnLaneGraph:
    """Candidates on lanes of any shape; see ``Candidates``."""

    traffic: LiveTraffic
    kind: str
    settings: SensorSettings
    graph: LaneGraph

    @property
    def possible(self) -> bool:
        """Whether anybody must yield anywhere but at signals, if the kind needs that."""
        control = self.graph.control
        return self.kind != CROSS or (control is not None and bool((control.kind == YIELD).any()))

    @cached_property
    def routes(self) -> Mapping[int, LaneRoute]:
        """The routes of cars with a past that are on no junction, some seconds of each free; see ``Candidates``."""
        now, sumo = self.traffic.frames[-1], self.traffic.running.sumo
        chosen = _driving_cars(self.traffic) & ~np.append(True, self.graph.in_junction)[now.lane]
        routes = {}
        for row in np.flatnonzero(chosen).tolist():
            edges, lane = list(sumo.vehicle.getRoute(str(now.vehicle_id[row]))), int(now.lane[row]) - 1
            edge = edge_of(self.graph, lane)
            if edge not in edges:
                continue
            route = route_of(self.graph, lane, edges[edges.index(edge) :])
            if self.kind == CROSS or route.left_m(now, row) > FREE_ROUTE_S * float(now.speed_mps[row]):
                routes[row] = route
        return routes

    def concerned(self, rows: IntArray, rng: np.random.Generator) -> Iterator[Concerned]:  # noqa: ARG002
        """Return whom each would have to let pass, or who leads its leader; see ``Candidates``."""
        if self.kind not in (BRAKE, CROSS):
            return repeat(Concerned())
        find = self._second_leader if self.kind == BRAKE else self._with_right_of_way
        return (find(int(row)) for row in rows)

    def _with_right_of_way(self, row: int) -> Concerned:
        name, seen = hidden_with_right_of_way(self.traffic, row, self.routes[row], self.settings)
        return Concerned(name, seen_before=seen)

    def _second_leader(self, row: int) -> Concerned:
        now = self.traffic.frames[-1]
        mine = with_ego(now, str(now.vehicle_id[row]), now.step, self.traffic.step_s)
        belief = believe(true_bodies(mine), ego_of(mine, self.routes[row].lanes), self.traffic.network.road)
        others = np.flatnonzero(np.arange(len(now)) != row)
        leaders = belief.leaders
        rows = np.where(leaders.body >= 0, np.append(others, NOBODY)[leaders.body], NOBODY)
        belief = replace(belief, leaders=replace(leaders, body=rows))
        return Concerned(hidden_second_leader(self.traffic, belief, 0, row, self.settings))


def _driving_cars(traffic: LiveTraffic) -> BoolArray:
    """Return which of the present frame are cars that drive and have been there for all of the tracking seconds."""
    now = traffic.frames[-1]
    cars = (now.length_m >= CAR_LENGTH_M[0]) & (now.length_m <= CAR_LENGTH_M[1]) & (now.speed_mps >= SLOWEST_MPS)
    if now.pedestrian is not None:
        cars &= ~now.pedestrian
    always = set.intersection(*(set(frame.vehicle_id.tolist()) for frame in traffic.frames))
    return np.asarray(cars & np.isin(now.vehicle_id, list(always)))


def hidden_second_leader(traffic: LiveTraffic, belief: Belief, place: int, row: int, settings: SensorSettings) -> str:
    """Return the leader's leader if it is hidden now, moves, and was in sight before; else an empty name."""
    now = traffic.frames[-1]
    first, second = (belief.leaders.body[place, rank] for rank in (0, 1))
    gap_m = belief.leaders.gap_m[place]
    if first < 0 or second < 0 or not 0.0 < gap_m[0] <= FARTHEST_LEADER_M or gap_m[1] > FARTHEST_HIDDEN_M:
        return ""
    other = int(second) % len(now)
    ego, name = str(now.vehicle_id[row]), str(now.vehicle_id[other])
    if now.speed_mps[other] < SLOWEST_MPS:
        return ""
    return name if hidden_after_sight(tuple(traffic.frames), ego, name, traffic.network.road, settings) else ""
