"""Chooses where an episode starts: the ego, and the vehicle that a provocation acts on.

A seed's traffic runs on under SUMO's own drivers. Of the last five seconds every frame is kept, so that a car that is
chosen now has been followed since then: its sensor is made to look at those frames in their order.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.closedloop.approaches import hidden_with_right_of_way
from harness.closedloop.beliefs import believed_by_each, ego_of, true_bodies
from harness.closedloop.inview import CHANGES_LANE_MPS, FARTHEST_LEADER_M, leader_in_view, stands_ahead
from harness.closedloop.plan import BRAKE, CROSS, DARK, DRIVEN_S, FREE, STOPPED, STREAMS, TRACKED_S
from harness.closedloop.routes import EgoRoute, edge_of, way_of
from harness.closedloop.sight import hidden_after_sight
from harness.closedloop.traffic import LiveTraffic, with_ego
from harness.config.sensor import SensorSettings
from harness.decisions.belief import NOBODY, Belief, believe
from harness.truth.frame import Frame
from harness.truth.sumo.brokendown import BROKEN_DOWN, drawn_car
from harness.truth.sumo.corridor_traffic import CAR_LENGTH_M
from harness.truth.sumo.fill import Placement
from mmpf.map.control import YIELD
from mmpf.numerics.arrays import BoolArray, IntArray

LOOK_AGAIN_S = {FREE: 2, BRAKE: 2, CROSS: 1, STOPPED: 1, DARK: 2}
"""Time between moments that are searched for candidates of each kind."""
GIVE_UP_S = {FREE: 40, BRAKE: 40, CROSS: 600, STOPPED: 120, DARK: 40}
"""After so long there are none."""
SECTION_MARGIN_M = 20.0
# An ego needs so much road as it covers in an episode at this speed at most.
ROOM_AT_MPS = 12.0
# On a network without a main road an ego needs so many seconds of way before the first signal.
FREE_WAY_S = 8.0
FARTHEST_HIDDEN_M = 70.0
STANDING = f"{BROKEN_DOWN}_ahead"
"""Name of the vehicle that stands in the ego's way."""
SLOWEST_MPS = 3.0
"""Whoever is slower does not brake in a way that matters."""


@dataclass(frozen=True)
class EpisodeStart:
    """A moment at which the ego's driver takes over from SUMO's.

    Attributes:
        kind: ``free``, or how the episode is provoked.
        provoked: Name of the vehicle that is provoked; empty for none.
        candidates: How many cars could have been the ego.
        looked_through: How many of them were looked at until one fitted, over all moments.
        frames: The tracking seconds, the last frame is the start's.
        way: The lanes that it is to drive on a network without a main road; None on one with.
        seen_before: Whether the vehicle that it must let pass had been in sight, or never had; None for other kinds.
        stands: Where the vehicle is put that is to stand in the ego's way; None for other kinds.
    """

    kind: str
    ego: str
    provoked: str
    candidates: int
    looked_through: int
    frames: tuple[Frame, ...]
    way: EgoRoute | None = None
    seen_before: bool | None = None
    stands: Placement | None = None

    @property
    def route(self) -> tuple[int, ...]:
        """Indices of the lanes that the ego's way goes by, of a graph of lanes."""
        return () if self.way is None else self.way.lanes


def episode_starts(
    traffic: LiveTraffic,
    kinds: Sequence[str],
    settings: SensorSettings,
    rng: np.random.Generator,
    flow_mps: float | None = None,
) -> Iterator[EpisodeStart | str]:
    """Yield a start of each kind while the traffic stands at it, in order of time; a kind alone if none is found.

    Args:
        traffic: The traffic; it goes on between starts of episodes.
        kinds: Kinds of episodes, each once.
        settings: The sensor.
        rng: Decides between candidates. Each kind has the same draws whichever others are asked for.
        flow_mps: Speed at which the traffic is to flow; None where it is not told.
    """
    step_s, waiting = traffic.step_s, [kind for kind in kinds if kind != CROSS or _has_right_of_way(traffic)]
    spawned = rng.spawn(max(STREAMS.values()) + 1)
    hopeless, looked = [kind for kind in kinds if kind not in waiting], dict.fromkeys(waiting, 0)
    for _ in range(round(TRACKED_S / step_s)):
        traffic.advance()
    for second in range(max(GIVE_UP_S[kind] for kind in kinds)):
        for kind in [kind for kind in waiting if second < GIVE_UP_S[kind] and second % LOOK_AGAIN_S[kind] == 0]:
            found = _find(traffic, kind, settings, spawned[STREAMS[kind]], flow_mps)
            looked[kind] += found.looked_through
            if found.ego:
                waiting.remove(kind)
                yield replace(found, looked_through=looked[kind])
        if all(second + 1 >= GIVE_UP_S[kind] for kind in waiting):
            break
        for _ in range(round(1.0 / step_s)):
            traffic.advance()
    yield from (*waiting, *hopeless)


def _has_right_of_way(traffic: LiveTraffic) -> bool:
    """Return whether anybody must yield anywhere on the network but at signals."""
    graph = traffic.network.road.graph
    return graph is not None and graph.control is not None and bool((graph.control.kind == YIELD).any())


def _find(
    traffic: LiveTraffic,
    kind: str,
    settings: SensorSettings,
    rng: np.random.Generator,
    flow_mps: float | None,
) -> EpisodeStart:
    """Look for an ego at the present moment; the start's is empty if there is none."""
    now = traffic.frames[-1]
    ways = {} if traffic.network.plane is None else _ways(traffic) if kind == CROSS else _free_ways(traffic)
    rows = _eligible(traffic) if traffic.network.plane is None else np.array(list(ways), dtype=np.int64)
    order = rows[rng.permutation(len(rows))]
    if kind == STOPPED and traffic.network.plane is None:
        concerned = _standing(traffic, settings, order, rng, flow_mps)
    else:
        concerned = _concerned(traffic, kind, settings, order, ways)
    for place, row in enumerate(order):
        about = concerned(place)
        if kind == FREE or about.provoked:
            ego = str(now.vehicle_id[row])
            frames = tuple(with_ego(frame, ego, step, traffic.step_s) for step, frame in enumerate(traffic.frames))
            return EpisodeStart(
                kind=kind,
                ego=ego,
                provoked=about.provoked,
                candidates=len(rows),
                looked_through=place + 1,
                frames=frames,
                way=ways.get(int(row)),
                seen_before=about.seen_before,
                stands=about.stands,
            )
    return EpisodeStart(kind, "", "", len(rows), len(rows), ())


@dataclass(frozen=True)
class _Concerned:
    """Finds the vehicle that a provocation would act on; see ``EpisodeStart``."""

    provoked: str = ""
    seen_before: bool | None = None
    stands: Placement | None = None


def _standing(
    traffic: LiveTraffic, settings: SensorSettings, rows: IntArray, rng: np.random.Generator, flow_mps: float | None
) -> Callable[[int], _Concerned]:
    """Return a function that gives, for each of some cars, where a vehicle would stand in its way."""
    vehicle = drawn_car(traffic.network, rng)

    def concerned(place: int) -> _Concerned:
        stands = stands_ahead(traffic, int(rows[place]), settings.range_m, vehicle, flow_mps)
        return _Concerned() if stands is None else _Concerned(STANDING, stands=stands)

    return concerned


def _concerned(
    traffic: LiveTraffic, kind: str, settings: SensorSettings, rows: IntArray, ways: Mapping[int, EgoRoute]
) -> Callable[[int], _Concerned]:
    """Return a function that gives, for each of some cars, the vehicle that a provocation would act on."""
    now, road = traffic.frames[-1], traffic.network.road
    if kind == BRAKE and traffic.network.plane is None:
        belief = believed_by_each(now, rows, road)
        return lambda place: _Concerned(_hidden_second_leader(traffic, belief, place, rows[place], settings))
    if kind == BRAKE:
        return lambda place: _Concerned(_second_on_way(traffic, rows[place], ways[int(rows[place])], settings))
    if kind == DARK and traffic.network.plane is None:
        belief = believed_by_each(now, rows, road)
        return lambda place: _Concerned(leader_in_view(traffic, belief, place, int(rows[place]), settings))
    if kind == CROSS and traffic.network.plane is not None:

        def with_right_of_way(place: int) -> _Concerned:
            row = int(rows[place])
            name, seen = hidden_with_right_of_way(traffic, row, ways[row], settings)
            return _Concerned(name, seen_before=seen)

        return with_right_of_way
    return lambda _: _Concerned()


def _eligible(traffic: LiveTraffic) -> IntArray:
    """Return the rows of the present frame that can be the ego: cars with a history that stay in a main lane."""
    now, network, sumo = traffic.frames[-1], traffic.network, traffic.running.sumo
    start_m, end_m = network.section_m
    room_m = DRIVEN_S * np.minimum(now.speed_mps, ROOM_AT_MPS)
    chosen = _driving_cars(traffic) & (now.lon_m > start_m + SECTION_MARGIN_M) & (now.lon_m + room_m < end_m)
    chosen &= np.isin(now.lane, np.asarray(network.ego_lanes)) & (np.abs(now.lat_speed_mps) <= CHANGES_LANE_MPS)
    last = network.main_road.edges[-1].name
    stays = [row for row in np.flatnonzero(chosen) if sumo.vehicle.getRoute(str(now.vehicle_id[row]))[-1] == last]
    return np.array(stays, dtype=np.int64)


def _free_ways(traffic: LiveTraffic) -> dict[int, EgoRoute]:
    """Return the ways of the rows that may be the ego where there is no main road: some seconds of each are free."""
    now, graph = traffic.frames[-1], traffic.network.road.graph
    assert graph is not None

    def is_free(row: int, way: EgoRoute) -> bool:
        left_m = way.left_m(graph, int(now.lane[row]) - 1, float(now.lon_m[row]), float(now.lat_m[row]))
        return left_m > FREE_WAY_S * float(now.speed_mps[row])

    return {row: way for row, way in _ways(traffic).items() if is_free(row, way)}


def _ways(traffic: LiveTraffic) -> dict[int, EgoRoute]:
    """Return the ways of the cars that drive with a past and are on no junction, by their rows."""
    now, road, sumo = traffic.frames[-1], traffic.network.road, traffic.running.sumo
    graph = road.graph
    assert graph is not None
    chosen = _driving_cars(traffic) & ~np.append(True, graph.in_junction)[now.lane]
    ways = {}
    for row in np.flatnonzero(chosen):
        name, lane = str(now.vehicle_id[row]), int(now.lane[row]) - 1
        route, edge = list(sumo.vehicle.getRoute(name)), edge_of(graph, lane)
        if edge not in route:
            continue
        ways[int(row)] = way_of(graph, lane, route[route.index(edge) :])
    return ways


def _driving_cars(traffic: LiveTraffic) -> BoolArray:
    """Return which of the present frame are cars that drive and have been there for all of the tracking seconds."""
    now = traffic.frames[-1]
    cars = (now.length_m >= CAR_LENGTH_M[0]) & (now.length_m <= CAR_LENGTH_M[1]) & (now.speed_mps >= SLOWEST_MPS)
    if now.pedestrian is not None:
        cars &= ~now.pedestrian
    always = set.intersection(*(set(frame.vehicle_id.tolist()) for frame in traffic.frames))
    return np.asarray(cars & np.isin(now.vehicle_id, list(always)))


def _second_on_way(traffic: LiveTraffic, row: int, way: EgoRoute, settings: SensorSettings) -> str:
    """Return a hidden leader's leader on an ego's way; see ``_hidden_second_leader``."""
    now = traffic.frames[-1]
    mine = with_ego(now, str(now.vehicle_id[row]), now.step, traffic.step_s)
    belief = believe(true_bodies(mine), ego_of(mine, way.lanes), traffic.network.road)
    others = np.flatnonzero(np.arange(len(now)) != row)
    leaders = belief.leaders
    rows = np.where(leaders.body >= 0, np.append(others, NOBODY)[leaders.body], NOBODY)
    return _hidden_second_leader(traffic, replace(belief, leaders=replace(leaders, body=rows)), 0, row, settings)


def _hidden_second_leader(traffic: LiveTraffic, belief: Belief, place: int, row: int, settings: SensorSettings) -> str:
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
