"""Keeps the traffic at its demand: vehicles enter upstream, and a slower exit limits the outflow.

The number of vehicles in the section is steered by what leaves it, because that acts at once, whereas a vehicle that
enters upstream reaches the section only later. In free flow nothing can be held back; then the inflow is steered.
"""

import math
from collections.abc import Sequence
from itertools import count

import numpy as np

from harness.truth.network.corridor import CorridorEdge
from harness.truth.network.demand import Demand
from harness.truth.network.network import Network
from harness.truth.sumo.brokendown import BROKEN_DOWN, clear_of, stand
from harness.truth.sumo.fill import FREE_SHARE, Placement, fill, leaving_share, main_lane_density, route_of
from harness.truth.sumo.population import Vehicle, draw_vehicle
from harness.truth.sumo.reading import Load, front_positions, read_load
from harness.truth.sumo.session import Sumo
from mmpf.map.road import Road

SLOWEST_MPS = 1.0
CONTROL_EVERY_S = 0.5
HOLD_WITHIN_S = 30.0
LEARN_WITHIN_S = 60.0
LEARN_AT_MOST, CORRECT_AT_MOST = 0.5, 0.8
RAMP_ENTRY_M = 8.0
# Drivers hold a little more than the equilibrium gap close to the speed limit.
SPEED_MARGIN = 1.15
INFLOW_GAIN = 4.0
GIVE_UP_WITHIN_M = 40.0


class TrafficControl:
    """Fills the road, lets vehicles in, and sets the exit's speed, through SUMO's interface."""

    def __init__(
        self,
        sumo: Sumo,
        network: Network,
        demand: Demand,
        rng: np.random.Generator,
        step_s: float,
        warm_up_s: float,
        broken_down: Sequence[Placement] = (),
    ) -> None:
        """Take hold of a simulation that has started and has no vehicles yet."""
        self._broken_down = tuple(broken_down)
        self._sumo = sumo
        self._network = network
        self._scheduled = demand
        self._warm_up_s = warm_up_s
        self._drivers = network.drivers
        self._rng = rng
        self._step_s = step_s
        self._names = count()
        self._routes: set[str] = set()
        lanes = network.main_road.main_lanes
        self._hold(demand.at(0.0))
        self._headways = LocalHeadways(sumo, network.corridor_road, demand.headway_profile)
        self._learned_flow = 0.0
        self._phase = float(rng.uniform())
        self._inflow_scale = 1.0
        self._waiting = [draw_vehicle(rng, network.drivers) for _ in range(lanes)]
        self._jitter = rng.uniform(-0.5, 0.5, lanes)
        self._next_spacing_m = [self._draw_spacing(lane) for lane in range(lanes)]
        self._next_ramp_s = [float(rng.uniform()) * self._ramp_interval_s() for _ in network.on_ramps]
        # SUMO puts the first vehicles on the road in its first step, and refuses speeds above the exit's limit then.
        self._next_control_s = 0.5 * step_s

    def fill(self) -> None:
        """Put the first vehicles on the road."""
        for placement in clear_of(fill(self._network, self._demand, self._rng), self._broken_down):
            self._add(placement)
        for number, placement in enumerate(self._broken_down):
            stand(self._sumo, f"{BROKEN_DOWN}{number}", placement)

    def _hold(self, demand: Demand) -> None:
        """Take a demand as the one to be held from now on."""
        network = self._network
        section_km = (network.section_m[1] - network.section_m[0]) / 1000.0
        self._demand = demand
        self._target = demand.density_veh_per_km_lane * network.main_road.main_lanes * section_km
        self._lane_density = main_lane_density(network, demand)

    def before_step(self, time_s: float) -> None:
        """Let vehicles in and adjust the exit before SUMO's next step, at a simulation time."""
        if time_s >= self._next_control_s:
            self._hold(self._scheduled.at(time_s - self._warm_up_s))
            self._steer(time_s, read_load(self._sumo, self._network.corridor_road))
            self._headways.apply()
            divert_late_vehicles(self._sumo, self._network)
            self._next_control_s = time_s + CONTROL_EVERY_S
        for lane in range(self._network.main_road.main_lanes):
            self._let_in(lane)
        for index in range(len(self._network.on_ramps)):
            self._let_in_by_ramp(index, time_s)

    def _steer(self, time_s: float, load: Load) -> None:
        if self._demand.density_veh_per_km_lane > self._drivers.critical_density_veh_per_km:
            self._steer_exit(time_s, (load.inside - self._target) / self._network.main_road.main_lanes)
        else:
            self._steer_inflow(load)

    def _steer_inflow(self, load: Load) -> None:
        """Let in as many as leave, counting those on their way, because they arrive only later."""
        corridor = self._network.main_road
        approach_m = self._network.section_m[0] - corridor.edges[0].start_m
        target = FREE_SHARE * self._target + self._lane_density * corridor.main_lanes * approach_m / 1000.0
        surplus = (load.approaching + load.inside) / target - 1.0
        slowness = load.mean_speed_mps / self._drivers.speed_mps(self._lane_density)
        self._inflow_scale = float(np.clip(slowness - INFLOW_GAIN * surplus, 0.4, 1.8))

    def _steer_exit(self, time_s: float, excess: float) -> None:
        usual = self._drivers.flow_veh_per_s(self._lane_density)
        wave = math.sin(2.0 * math.pi * (time_s / self._demand.wave_period_s + self._phase))
        correction = excess / HOLD_WITHIN_S
        self._learned_flow += correction / LEARN_WITHIN_S * CONTROL_EVERY_S
        self._learned_flow = float(np.clip(self._learned_flow, -LEARN_AT_MOST * usual, LEARN_AT_MOST * usual))
        correction = float(np.clip(correction + self._learned_flow, -CORRECT_AT_MOST * usual, CORRECT_AT_MOST * usual))
        flow = usual * (1.0 + self._demand.exit_wave_amplitude * wave) + correction
        self._limit_speed(self._network.main_road.edges[-1], flow)

    def _limit_speed(self, edge: CorridorEdge, flow_veh_per_s: float) -> None:
        """Let at most a flow, per lane, through an edge by lowering its speed limit."""
        speed_mps = self._drivers.congested_speed_mps(flow_veh_per_s) * SPEED_MARGIN
        self._sumo.edge.setMaxSpeed(edge.name, float(np.clip(speed_mps, SLOWEST_MPS, edge.speed_limit_mps)))

    def _let_in(self, lane: int) -> None:
        """Let the waiting vehicle of a main lane in once the last one is its spacing ahead."""
        edge = self._network.main_road.edges[0]
        lane_index = lane + edge.extra_lanes
        vehicle = self._waiting[lane]
        wish_mps = min(edge.speed_limit_mps * vehicle.speed_factor, self._drivers.speed_mps(self._lane_density) * 1.1)
        rearmost = self._rearmost(f"{edge.name}_{lane_index}")
        position_m, speed_mps = 0.5, wish_mps
        if rearmost is not None:
            ahead_m, ahead_mps, ahead_length_m = rearmost
            closest_m = ahead_m - ahead_length_m - vehicle.minimum_gap_m - 1.0
            position_m = min(closest_m, ahead_m + ahead_mps * self._step_s - self._next_spacing_m[lane])
            speed_mps = _safe_entry_speed(vehicle, wish_mps, ahead_m - ahead_length_m - max(0.5, position_m), ahead_mps)
            if position_m < 0.5:
                return
        share = leaving_share(self._network, self._demand)
        route = route_of(self._network, 0, lane, share, self._rng)
        self._add(Placement(vehicle, edge.name, lane_index, min(position_m, 5.0), speed_mps, route))
        self._waiting[lane] = draw_vehicle(self._rng, self._network.drivers)
        self._next_spacing_m[lane] = self._draw_spacing(lane)

    def _draw_spacing(self, lane: int) -> float:
        """Return the front-to-front distance to the next vehicle: scattered about an even grid, so that counts hold."""
        crowding = min(1.0, self._lane_density / self._drivers.critical_density_veh_per_km)
        jitter = float(self._rng.uniform(-0.5, 0.5)) * (1.0 - 0.7 * crowding)
        spacings = 1.0 + jitter - self._jitter[lane]
        self._jitter[lane] = jitter
        return float(spacings * 1000.0 / (self._lane_density * self._inflow_scale))

    def _let_in_by_ramp(self, index: int, time_s: float) -> None:
        ramp = self._network.on_ramps[index]
        if self._demand.on_ramp_veh_per_h <= 0.0 or time_s < self._next_ramp_s[index]:
            return
        vehicle = draw_vehicle(self._rng, self._network.drivers)
        wish_mps = 0.8 * ramp.speed_limit_mps
        rearmost = self._rearmost(f"{ramp.name}_0")
        if rearmost is not None:
            ahead_m, ahead_mps, ahead_length_m = rearmost
            gap_m = ahead_m - ahead_length_m - RAMP_ENTRY_M
            if gap_m < vehicle.minimum_gap_m + 3.0:
                return
            wish_mps = _safe_entry_speed(vehicle, wish_mps, gap_m, ahead_mps)
        route = (ramp.name, *(edge.name for edge in self._network.main_road.edges[ramp.index :]))
        self._add(Placement(vehicle, ramp.name, 0, RAMP_ENTRY_M, wish_mps, route))
        self._next_ramp_s[index] += self._ramp_interval_s() * float(self._rng.uniform(0.6, 1.4))

    def _ramp_interval_s(self) -> float:
        return 3600.0 / max(1.0, self._demand.on_ramp_veh_per_h)

    def _rearmost(self, lane: str) -> tuple[float, float, float] | None:
        """Return front position, speed and length of a lane's last vehicle, None if it is empty."""
        names = self._sumo.lane.getLastStepVehicleIDs(lane)
        if not names:
            return None
        vehicle = self._sumo.vehicle
        last = min(names, key=vehicle.getLanePosition)
        return vehicle.getLanePosition(last), vehicle.getSpeed(last), vehicle.getLength(last)

    def _add(self, placement: Placement) -> None:
        sumo, vehicle = self._sumo.vehicle, placement.vehicle
        name = f"{vehicle.kind}{next(self._names)}"
        speed_limit_mps = self._sumo.lane.getMaxSpeed(f"{placement.edge}_{placement.lane_index}")
        speed_mps = min(placement.speed_mps, 0.99 * speed_limit_mps * min(1.0, vehicle.speed_factor))
        sumo.add(
            name,
            self._route(placement.route),
            vehicle.kind,
            departLane=str(placement.lane_index),
            departPos=f"{placement.position_m:.3f}",
            departSpeed=f"{speed_mps:.3f}",
        )
        sumo.setLength(name, vehicle.length_m)
        sumo.setWidth(name, vehicle.width_m)
        sumo.setMinGap(name, vehicle.minimum_gap_m)
        sumo.setTau(name, vehicle.headway_s)
        self._headways.add(name, vehicle.headway_s)
        sumo.setAccel(name, vehicle.accel_mps2)
        sumo.setSpeedFactor(name, vehicle.speed_factor)
        sumo.setLateralAlignment(name, f"{vehicle.lateral_offset_m:.3f}")
        if vehicle.assertiveness is not None:
            sumo.setParameter(name, "laneChangeModel.lcAssertive", f"{vehicle.assertiveness:.4f}")

    def _route(self, edges: tuple[str, ...]) -> str:
        name = ">".join(edges)
        if name not in self._routes:
            self._sumo.route.add(name, list(edges))
            self._routes.add(name)
        return name


def _safe_entry_speed(vehicle: Vehicle, wish_mps: float, gap_m: float, ahead_mps: float) -> float:
    """Return a speed from which a vehicle can follow the one ahead without braking hard."""
    room_m = gap_m - vehicle.minimum_gap_m
    if room_m > wish_mps * vehicle.headway_s:
        return wish_mps if wish_mps <= ahead_mps else min(wish_mps, ahead_mps + 0.1 * room_m)
    return max(0.0, min(wish_mps, ahead_mps, room_m / vehicle.headway_s))


class LocalHeadways:
    """Sets each vehicle's time headway to its driver's own times the factor of the place."""

    def __init__(self, sumo: Sumo, road: Road, profile: tuple[tuple[float, float], ...]) -> None:
        """Take positions along the road and the factors there, linear in between; none for 1 everywhere."""
        self._sumo = sumo
        self._road = road
        self._lon_m, self._factor = np.array(profile or ((0.0, 1.0),)).T
        self._own_s: dict[str, float] = {}
        self._needed = bool(profile)

    def add(self, name: str, headway_s: float) -> None:
        """Remember a vehicle's own headway."""
        self._own_s[name] = headway_s

    def apply(self) -> None:
        """Set the headways of all vehicles on the road that it remembers."""
        if not self._needed:
            return
        vehicle = self._sumo.vehicle
        names = vehicle.getIDList()
        lon_m, _ = front_positions(self._sumo, self._road, names)
        for name, factor in zip(names, np.interp(lon_m, self._lon_m, self._factor), strict=True):
            if name in self._own_s:
                vehicle.setTau(name, self._own_s[name] * float(factor))


def divert_late_vehicles(sumo: Sumo, network: Network) -> None:
    """Give vehicles that are on the wrong lane just before an exit the route that their lane leads to."""
    edges = network.main_road.edges
    for ramp in network.off_ramps:
        edge = edges[ramp.index]
        if edge.extra_lanes == 0:
            continue
        onward = [entry.name for entry in edges[ramp.index :]]
        off = [edge.name, ramp.name]
        for lane in range(edge.lanes):
            route = off if lane < edge.extra_lanes else onward
            for name in sumo.lane.getLastStepVehicleIDs(f"{edge.name}_{lane}"):
                near = edge.length_m - sumo.vehicle.getLanePosition(name) < GIVE_UP_WITHIN_M
                if near and (ramp.name in sumo.vehicle.getRoute(name)) != (route is off):
                    sumo.vehicle.setRoute(name, route)
