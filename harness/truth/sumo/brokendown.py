"""Broken-down vehicles: each stands in a main lane from before the first frame, and traffic passes it."""

from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np

from harness.common.errors import InputError
from harness.truth.network.network import Network
from harness.truth.sumo.fill import Placement
from harness.truth.sumo.population import Vehicle, draw_vehicle
from harness.truth.sumo.session import Sumo

BROKEN_DOWN = "broken"
"""What their names begin with."""
FIRST_AT, ONE_WITHIN, LAST_AT = 0.25, 0.3, 0.85
"""Shares of the section: the first stands behind the one, so much of it is for each, and none is beyond the last."""
APART_M = 40.0
"""Each has so much of the section for itself."""
FROM_EDGE_END_M = 15.0
"""Room between it and the next edge, so that drivers of one edge steer around it."""
CLEAR_BEHIND_M, CLEAR_AHEAD_M = 60.0, 12.0
"""Who is put on the road this near to one in its lane could neither stop nor steer around it."""
STREAM = 7
STANDS_S = 1e6


def place_broken_down(network: Network, count: int, seed: np.random.SeedSequence | int) -> list[Placement]:
    """Return where vehicles have broken down: one in each part of the section, those that follow in other lanes.

    Raises:
        InputError: The network has no main road of two lanes or more, or its section is too short for so many.
    """
    if not count:
        return []
    if network.configuration is not None or network.corridor is None:
        raise InputError(
            f"`broken_down`: {network.name} has no main road with held traffic; take one that has, such as us101"
        )
    lanes, (start_m, end_m) = network.corridor.main_lanes, network.section_m
    if lanes < 2:
        raise InputError(f"`broken_down`: the one main lane of {network.name} would be blocked; it needs two or more")
    first_m = start_m + FIRST_AT * (end_m - start_m)
    last_m = start_m + min(LAST_AT, FIRST_AT + ONE_WITHIN * count) * (end_m - start_m)
    most = int((LAST_AT - FIRST_AT) * (end_m - start_m) / APART_M)
    if count > most:
        raise InputError(f"`broken_down` {count}: the section of {network.name} has room for {most}; give at most that")
    base = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    rng = np.random.default_rng(np.random.SeedSequence(base.entropy, spawn_key=(*base.spawn_key, STREAM)))
    order = rng.permutation(lanes)
    parts_m = np.linspace(first_m, last_m, count + 1)
    return [
        placed(network, int(order[number % lanes]), float(rng.uniform(low_m, high_m)), drawn_car(network, rng))
        for number, (low_m, high_m) in enumerate(pairwise(parts_m))
    ]


def placed(
    network: Network, lane: int, wished_m: float, vehicle: Vehicle, from_edge_end_m: float = FROM_EDGE_END_M
) -> Placement:
    """Return the placement of a standing vehicle on a main lane, on one edge and off its ends.

    Args:
        lane: Main lane, counted from the right, from 0.
        wished_m: Longitudinal position of its front bumper; it is moved as far as the edge's ends ask for.
    """
    edges = network.main_road.edges
    index = max(k for k, edge in enumerate(edges) if wished_m >= edge.start_m)
    edge = edges[index]
    most_m = max(from_edge_end_m, edge.length_m - from_edge_end_m)
    position_m = round(float(np.clip(wished_m - edge.start_m, from_edge_end_m, most_m)), 3)
    route = tuple(each.name for each in edges[index:])
    return Placement(vehicle, edge.name, lane + edge.extra_lanes, position_m, 0.0, route)


def drawn_car(network: Network, rng: np.random.Generator) -> Vehicle:
    """Draw a car of a network's drivers."""
    while (vehicle := draw_vehicle(rng, network.drivers)).kind != "car":
        pass
    return vehicle


def stand(sumo: Sumo, name: str, placement: Placement) -> None:
    """Put a vehicle on the road that stands there for good; it is there after SUMO's next step."""
    vehicle, its = sumo.vehicle, placement.vehicle
    sumo.route.add(f"route of {name}", list(placement.route))
    place_m = f"{placement.position_m:.3f}"
    lane = str(placement.lane_index)
    vehicle.add(name, f"route of {name}", its.kind, departLane=lane, departPos=place_m, departSpeed="0")
    vehicle.setLength(name, its.length_m)
    vehicle.setWidth(name, its.width_m)
    vehicle.setStop(name, placement.edge, placement.position_m, placement.lane_index, duration=STANDS_S)


def clear_of(placements: Iterable[Placement], broken: Sequence[Placement]) -> list[Placement]:
    """Return the placements without those that lie too near to a vehicle that has broken down, on its lane."""

    def is_near(placement: Placement, other: Placement) -> bool:
        same_lane = (placement.edge, placement.lane_index) == (other.edge, other.lane_index)
        ahead_m = placement.position_m - other.position_m
        return same_lane and -CLEAR_BEHIND_M < ahead_m < CLEAR_AHEAD_M + placement.vehicle.length_m

    return [placement for placement in placements if not any(is_near(placement, other) for other in broken)]
