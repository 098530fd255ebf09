"""What drivers do beyond their car-following model: headways drawn per driver, routes changed on the way."""

from __future__ import annotations

import numpy as np

from harness.truth.network.network import Network
from harness.truth.sumo.reading import front_positions
from harness.truth.sumo.session import Sumo
from mmpf.road import Road


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
        """Set the headways of all vehicles on the road."""
        if not self._needed:
            return
        vehicle = self._sumo.vehicle
        names = vehicle.getIDList()
        lon_m, _ = front_positions(self._sumo, self._road, names)
        for name, factor in zip(names, np.interp(lon_m, self._lon_m, self._factor), strict=True):
            vehicle.setTau(name, self._own_s[name] * float(factor))


GIVE_UP_WITHIN_M = 40.0


def divert_late_vehicles(sumo: Sumo, network: Network) -> None:
    """Give vehicles that are on the wrong lane just before an exit the route that their lane leads to."""
    edges = network.corridor.edges
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
