"""Vehicles in the plane as they are read, not as they were half a second ago."""

from types import SimpleNamespace

import numpy as np
import pytest

from harness.truth.network.lanegraph import PlaneNetwork
from harness.truth.sumo.causal import CausalFilter
from harness.truth.sumo.presentplane import PresentPlane
from tests.mmpf.map.scenes import graph_of

GRAPH = graph_of({"a_0": [(0, 0), (100, 0)], "b_0": [(0, 0), (-100, 1)]})


class VehicleApi:
    """One car on a lane, 4 m long, whose front is at x = 20."""

    def __init__(self):
        self.x, self.lane = 20.0, "a_0"

    def getIDList(self):  # noqa: N802
        return ("car",)

    def getPosition(self, name):  # noqa: N802
        return self.x, 0.0

    def __getattr__(self, what):
        values = {
            "getLength": 4.0, "getWidth": 1.8, "getVehicleClass": "passenger", "getDeparture": 0.0, "getAngle": 90.0,
            "getSpeed": 7.0, "getAcceleration": -1.0, "getLaneID": self.lane, "isStoppedParking": False,
        }  # fmt: skip
        return lambda name: values[what]


def test_a_car_is_where_its_middle_is_now_on_its_lane_as_fast_as_it_is():
    vehicle = VehicleApi()
    sumo = SimpleNamespace(
        vehicle=vehicle, person=SimpleNamespace(getIDList=tuple), simulation=SimpleNamespace(getTime=lambda: 0.0)
    )
    reading, smooth = PresentPlane(sumo, PlaneNetwork(GRAPH, (0.0, 0.0)), knows_persons=False), CausalFilter(0.1)
    for step in range(3):
        frame = smooth.filtered(reading.read(step, 0.1 * step))
        assert frame.lon_m[0] == pytest.approx(vehicle.x - 2.0)
        assert (frame.lane[0], frame.speed_mps[0], frame.direction_rad[0]) == (1, 7.0, 0.0)
        vehicle.x += 0.7
    assert frame.pedestrian is None


def test_a_heading_that_goes_round_is_left_as_it_is():
    class West(VehicleApi):
        """The same car, on its way west, now a little north and now a little south of it."""

        angle = 269.0

        def __getattr__(self, what):
            return (lambda name: self.angle) if what == "getAngle" else super().__getattr__(what)

    vehicle = West()
    sumo = SimpleNamespace(
        vehicle=vehicle, person=SimpleNamespace(getIDList=tuple), simulation=SimpleNamespace(getTime=lambda: 0.0)
    )
    smooth = CausalFilter(0.1)
    for angle in (269.0, 271.0):
        vehicle.angle = angle
        # A new reader each time: the first look takes SUMO's angle.
        frame = smooth.filtered(PresentPlane(sumo, PlaneNetwork(GRAPH, (0.0, 0.0)), knows_persons=False).read(0, 0.0))
        assert frame.heading_rad[0] == pytest.approx(
            np.radians(90.0 - angle + (360.0 if angle > 270.0 else 0.0)), abs=1e-4
        )
