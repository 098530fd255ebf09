"""The vehicles on the main road when the simulation starts: near equilibrium, with waves if it is dense."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from harness.truth.network.corridor import CorridorEdge, Ramp
from harness.truth.network.demand import Demand, Drivers
from harness.truth.network.network import Network
from harness.truth.sumo.population import Vehicle, draw_vehicle
from mmpf.numerics.arrays import FloatArray

EXTRA_LANE_SHARE = 0.35
LANES_NEAR_RAMP = 2
LEAVE_WITHIN_M = 80.0
# In free flow the traffic that merges in and the slowing down behind slow vehicles add this much in the section.
FREE_SHARE = 0.97


@dataclass(frozen=True)
class Placement:
    """A vehicle to be put on an edge, its lane counted from the right, its position that of the front bumper."""

    vehicle: Vehicle
    edge: str
    lane_index: int
    position_m: float
    speed_mps: float
    route: tuple[str, ...]


def fill(network: Network, demand: Demand, rng: np.random.Generator) -> list[Placement]:
    """Return vehicles for the main road and the on-ramps at the demanded density."""
    edges = network.main_road.edges
    lon_m = np.arange(edges[0].start_m, edges[-1].end_m + 1.0)
    density = _density_profile(network, demand, lon_m, rng)
    offsets = (rng.permutation(network.main_road.main_lanes) + rng.uniform()) / network.main_road.main_lanes
    placements: list[Placement] = []
    for lane, offset in enumerate(offsets):
        placements += _fill_main_lane(network, demand, lane, float(offset), lon_m, density, rng)
    for index, edge in enumerate(edges):
        for lane in range(edge.extra_lanes):
            placements += _fill_extra_lane(network, demand, index, lane, rng)
    for ramp in network.on_ramps:
        placements += _fill_on_ramp(network, demand, ramp, rng)
    return placements


def main_lane_density(network: Network, demand: Demand) -> float:
    """Return the density of one main lane, per km, once what the ramps and slow vehicles add is taken off."""
    start_m, end_m = network.section_m
    extra_m = sum(
        edge.extra_lanes * max(0.0, min(edge.end_m, end_m) - max(edge.start_m, start_m))
        for edge in network.main_road.edges
    )
    share = EXTRA_LANE_SHARE * extra_m / (network.main_road.main_lanes * (end_m - start_m))
    density = demand.density_veh_per_km_lane / (1.0 + share)
    congested = demand.density_veh_per_km_lane > network.drivers.critical_density_veh_per_km
    return density if congested else density * FREE_SHARE


def leaving_share(network: Network, demand: Demand) -> float:
    """Return the share of the vehicles on the lanes beside an off-ramp that leave by it."""
    lanes = min(LANES_NEAR_RAMP, network.main_road.main_lanes)
    flow = 3600.0 * lanes * network.drivers.flow_veh_per_s(demand.density_veh_per_km_lane)
    return min(1.0, demand.off_ramp_veh_per_h / flow)


def route_of(
    network: Network, index: int, lane_from_right: int, share: float, rng: np.random.Generator
) -> tuple[str, ...]:
    """Return the route of a vehicle on a main lane of corridor edge ``index``: to the end, or off by a ramp ahead."""
    names = tuple(edge.name for edge in network.main_road.edges)
    if lane_from_right < LANES_NEAR_RAMP:
        for ramp in network.off_ramps:
            if index < ramp.index and rng.uniform() < share:
                return (*names[index : ramp.index + 1], ramp.name)
    return names[index:]


def _density_profile(network: Network, demand: Demand, lon_m: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return one main lane's density along the road, per metre, its mean over the section as demanded."""
    wavelength_m = network.drivers.wave_speed_mps * demand.wave_period_s
    waves = 1.0 + demand.wave_amplitude * np.sin(2.0 * np.pi * (lon_m / wavelength_m + rng.uniform()))
    inside = (lon_m >= network.section_m[0]) & (lon_m < network.section_m[1])
    return np.asarray(waves / waves[inside].mean() * main_lane_density(network, demand) / 1000.0)


def _fill_main_lane(
    network: Network,
    demand: Demand,
    lane: int,
    offset: float,
    lon_m: FloatArray,
    density: FloatArray,
    rng: np.random.Generator,
) -> Iterator[Placement]:
    count_at = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(lon_m))])
    count = int(count_at[-1] - offset) + 1
    vehicles = [draw_vehicle(rng, network.drivers) for _ in range(count)]
    fronts_m = np.interp(np.arange(count) + offset + _scatter(vehicles, demand, network.drivers, rng), count_at, lon_m)
    speeds = [network.drivers.speed_mps(1000.0 * float(np.interp(x, lon_m, density))) for x in fronts_m]
    share = leaving_share(network, demand)
    limit_m = np.inf
    for vehicle, wished_m, speed in reversed(list(zip(vehicles, fronts_m, speeds, strict=True))):
        index, edge = _edge_at(network, float(wished_m))
        speed_mps = min(speed, edge.speed_limit_mps * vehicle.speed_factor)
        front_m = min(float(wished_m), limit_m - vehicle.minimum_gap_m - 0.6 * vehicle.headway_s * speed_mps)
        index, edge = _edge_at(network, front_m)
        limit_m = front_m - vehicle.length_m
        if front_m < edge.start_m:
            continue
        route = route_of(network, index, lane, share, rng)
        yield Placement(vehicle, edge.name, lane + edge.extra_lanes, front_m - edge.start_m, speed_mps, route)


def _scatter(vehicles: list[Vehicle], demand: Demand, drivers: Drivers, rng: np.random.Generator) -> FloatArray:
    """Return how far each vehicle is off an even spacing, in spacings: at random if free, by its own gap if dense."""
    crowding = min(1.0, demand.density_veh_per_km_lane / drivers.critical_density_veh_per_km)
    speed = drivers.speed_mps(demand.density_veh_per_km_lane)
    needs = np.array([v.length_m + v.minimum_gap_m + v.headway_s * speed for v in vehicles])
    walk = np.cumsum(needs / needs.mean() - 1.0)
    jitter = rng.uniform(-0.35, 0.35, len(vehicles))
    return np.asarray(crowding * (walk - walk.mean()) + (1.0 - crowding) * jitter)


def _edge_at(network: Network, lon_m: float) -> tuple[int, CorridorEdge]:
    edges = network.main_road.edges
    for index in range(len(edges) - 1, 0, -1):
        if lon_m >= edges[index].start_m:
            return index, edges[index]
    return 0, edges[0]


def _fill_extra_lane(
    network: Network, demand: Demand, index: int, lane: int, rng: np.random.Generator
) -> Iterator[Placement]:
    edge = network.main_road.edges[index]
    spacing_m = 1000.0 / (EXTRA_LANE_SHARE * demand.density_veh_per_km_lane)
    speed = network.drivers.speed_mps(demand.density_veh_per_km_lane)
    names = tuple(entry.name for entry in network.main_road.edges)
    exits = [ramp for ramp in network.off_ramps if ramp.index == index]
    ramp_flow = demand.on_ramp_veh_per_h + demand.off_ramp_veh_per_h
    position_m = float(rng.uniform(0.0, spacing_m)) + 10.0
    while position_m < edge.length_m - 10.0:
        near_end = edge.length_m - position_m < LEAVE_WITHIN_M
        leaves = near_end or rng.uniform() * ramp_flow < demand.off_ramp_veh_per_h
        route = (edge.name, exits[0].name) if exits and leaves else names[index:]
        yield Placement(draw_vehicle(rng, network.drivers), edge.name, lane, position_m, speed, route)
        position_m += spacing_m * float(rng.uniform(0.8, 1.2))


def _fill_on_ramp(network: Network, demand: Demand, ramp: Ramp, rng: np.random.Generator) -> Iterator[Placement]:
    if demand.on_ramp_veh_per_h <= 0.0:
        return
    speed = min(0.8 * ramp.speed_limit_mps, network.drivers.speed_mps(demand.density_veh_per_km_lane) + 3.0)
    spacing_m = speed * 3600.0 / demand.on_ramp_veh_per_h
    route = (ramp.name, *(edge.name for edge in network.main_road.edges[ramp.index :]))
    position_m = float(rng.uniform(0.0, spacing_m)) + 10.0
    while position_m < ramp.length_m - 20.0:
        yield Placement(draw_vehicle(rng, network.drivers), ramp.name, 0, position_m, speed, route)
        position_m += spacing_m
