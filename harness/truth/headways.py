"""Time headways that depend on the place: where drivers keep larger gaps, less traffic fits through.

This is the flow-conserving bottleneck of Treiber, Hennecke and Helbing (Congested traffic states in empirical
observations and microscopic simulations, Physical Review E 62, 2000, section IV).
"""

from __future__ import annotations

import numpy as np

from harness.truth.reading import front_positions
from harness.truth.session import Sumo
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
