"""Drivers who miss an exit drive on, and drivers who cannot merge in time leave: nobody stops and waits for a gap.

SUMO's vehicles never give up their route: one that has not got onto the lane to its exit stops at the lane's end and
closes it for all behind, which no recording shows.
"""

from __future__ import annotations

from harness.truth.network import Network
from harness.truth.session import Sumo

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
