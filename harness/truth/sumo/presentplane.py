"""SUMO's vehicles in the plane at the moment that they are read, for a loop that acts on them."""

from __future__ import annotations

import numpy as np

from harness.truth.frame import Frame
from harness.truth.network.lanegraph import PlaneNetwork
from harness.truth.sumo.planereading import PlaneReader, Snapshot
from harness.truth.sumo.planesmoothing import NO_EGO_INDEX, lanes_of
from harness.truth.sumo.session import Sumo
from harness.truth.sumo.smoothing import DECIMALS
from mmpf.numerics.arrays import BoolArray, FloatArray


class PresentPlane:
    """Reads frames of a network without a main road, none of which has an ego."""

    def __init__(self, sumo: Sumo, plane: PlaneNetwork, knows_persons: bool) -> None:
        """Begin without a past.

        Args:
            sumo: The simulation.
            plane: The lanes.
            knows_persons: Whether frames tell who is on foot.
        """
        self._sumo, self._plane, self._knows_persons = sumo, plane, knows_persons
        self._reader = PlaneReader(sumo, plane)

    def read(self, step: int, time_s: float) -> Frame:
        """Return everybody at this moment."""
        now = self._reader.read()
        names = list(now.row)
        place, heading = now.centres().reshape(-1, 2), _rounded(now.heading_rad)
        on_foot = np.array([body.is_pedestrian for body in now.body], dtype=np.bool_)
        return Frame(
            step=step,
            time_s=time_s,
            episode=0,
            ego=NO_EGO_INDEX,
            vehicle_id=np.array(names, dtype=np.str_),
            lon_m=place[:, 0],
            lat_m=place[:, 1],
            heading_rad=heading,
            speed_mps=self._of_each(now, on_foot, "getSpeed"),
            lat_speed_mps=np.zeros(len(names)),
            accel_mps2=self._of_each(now, on_foot, "getAcceleration"),
            lane=1 + lanes_of(now.lanes, self._plane.graph, place),
            length_m=np.array([body.length_m for body in now.body], dtype=np.float64),
            width_m=np.array([body.width_m for body in now.body], dtype=np.float64),
            direction_rad=heading,
            pedestrian=on_foot if self._knows_persons else None,
            signals=now.signals,
        )

    def _of_each(self, now: Snapshot, on_foot: BoolArray, what: str) -> FloatArray:
        """Return a quantity of each vehicle, 0 of who is on foot, shape (n,)."""
        ask = getattr(self._sumo.vehicle, what)
        return np.array([0.0 if walks else ask(name) for name, walks in zip(now.row, on_foot, strict=True)])


def _rounded(values: FloatArray) -> FloatArray:
    return np.asarray(np.round(values, DECIMALS) + 0.0)
