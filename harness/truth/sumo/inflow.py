"""Keeps a density on a network in the plane by controlling its inflows.

The network's own flows say in which shares vehicles take which routes; SUMO's scale says how many do. Below the
density the flows let in more than leave, above it none, so that the number of vehicles on all lanes stays what was
asked for, as far as the entries have room for it.
"""

from harness.truth.sumo.session import Sumo

LOOK_EVERY_STEPS = 10
MOST_SCALE = 3.0
"""Largest multiple of the network's flows."""
BAND = 0.1
"""Share of the vehicles asked for over which the flows go from their most to none."""
REACHED = 0.95


class Inflow:
    """Steers SUMO's scale until the density is reached, and from then on."""

    def __init__(self, sumo: Sumo, density_veh_per_km_lane: float, lanes_m: float) -> None:
        """Hold a density, vehicles per kilometre and lane, on lanes of a length in all, metres."""
        self.reached = False
        self._sumo = sumo
        self._target = density_veh_per_km_lane * lanes_m / 1000.0
        self._steps = 0

    def before_step(self, _time_s: float) -> None:
        """Look at the traffic once a second and let in as many as are missing."""
        if self._steps % LOOK_EVERY_STEPS == 0:
            present = self._sumo.vehicle.getIDCount()
            self.reached = self.reached or present >= REACHED * self._target
            # Those that wait for room to enter count, or they would all come later.
            count = present + len(self._sumo.simulation.getPendingVehicles())
            self._sumo.simulation.setScale(scale_for(count, self._target))
        self._steps += 1


def scale_for(count: int, target: float) -> float:
    """Return the multiple of the flows for a number of vehicles on the network where another is asked for."""
    missing = (target - count) / (BAND * target) + 0.5
    return MOST_SCALE * min(1.0, max(0.0, missing))
