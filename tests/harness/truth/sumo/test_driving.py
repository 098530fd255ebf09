"""Drivers, schedules, local headways and late exits: what a network says is what its traffic does."""

import numpy as np
import pytest
from pydantic import ValidationError

from harness.truth.network.demand import Demand, Drivers
from harness.truth.network.network import load_network
from harness.truth.sumo.control import LocalHeadways, divert_late_vehicles
from harness.truth.sumo.population import draw_vehicle


def demand(schedule):
    return Demand(40.0, 400.0, 300.0, 0.5, 0.6, 120.0, schedule=schedule)


def test_a_schedule_gives_density_and_waves_from_each_time_on():
    held = demand(((0.0, 37.0, 0.2), (300.0, 46.0, 1.0)))
    at = [held.at(time) for time in (-20.0, 0.0, 299.9, 300.0, 9000.0)]
    assert [entry.density_veh_per_km_lane for entry in at] == [37.0, 37.0, 37.0, 46.0, 46.0]
    assert [entry.exit_wave_amplitude for entry in at] == pytest.approx([0.12, 0.12, 0.12, 0.6, 0.6])


def test_without_a_schedule_the_demand_stays_as_it_is():
    held = demand(())
    assert held.at(100.0) == held


def test_vehicles_are_drawn_about_the_drivers_means():
    drivers = Drivers(headway_s=1.6, minimum_gap_m=3.4, acceleration_scale=1.2)
    rng = np.random.default_rng(1)
    cars = [v for v in (draw_vehicle(rng, drivers) for _ in range(2000)) if v.kind == "car"]
    assert np.mean([car.headway_s for car in cars]) == pytest.approx(1.6, rel=0.02)
    assert np.mean([car.minimum_gap_m for car in cars]) == pytest.approx(3.4, rel=0.02)
    assert np.mean([car.accel_mps2 for car in cars]) == pytest.approx(1.2 * 1.5, rel=0.02)


def test_drivers_are_as_assertive_as_the_network_says_and_as_their_type_if_it_says_nothing():
    rng = np.random.default_rng(1)
    assert draw_vehicle(rng, Drivers(assertiveness=2.5)).assertiveness == 2.5
    assert draw_vehicle(rng, Drivers()).assertiveness is None


def test_the_relation_of_speed_and_density_is_the_drivers():
    drivers = Drivers(headway_s=1.6, minimum_gap_m=3.4)
    assert drivers.wave_speed_mps == pytest.approx((4.64 + 3.4) / 1.6)
    assert drivers.speed_mps(60.0) < Drivers().speed_mps(60.0)


@pytest.mark.parametrize("wrong", [{"headway_s": 0.1}, {"minimum_gap_m": "far"}, {"mood": 1.0}, {"assertiveness": 0.0}])
def test_drivers_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ValidationError):
        Drivers.model_validate(wrong)


class Vehicles:
    """Stands in for SUMO: vehicles at places along the main road, on a lane of an edge."""

    def __init__(self, places, edge="auxiliary", lanes=None, routes=None):
        self.vehicle = self.lane = self
        self.places, self.edge, self.lanes, self.routes = places, edge, lanes or {}, routes or {}
        self.tau = {}

    def getIDList(self):  # noqa: N802
        return tuple(self.places)

    def getPosition(self, name):  # noqa: N802
        return self.places[name], 5.0

    def setTau(self, name, tau_s):  # noqa: N802
        self.tau[name] = tau_s

    def getLastStepVehicleIDs(self, lane):  # noqa: N802
        return tuple(name for name, index in self.lanes.items() if f"{self.edge}_{index}" == lane)

    def getLanePosition(self, name):  # noqa: N802
        return self.places[name]

    def getRoute(self, name):  # noqa: N802
        return self.routes[name]

    def setRoute(self, name, route):  # noqa: N802
        self.routes[name] = route


def test_headways_are_multiplied_by_the_factor_of_the_place():
    sumo = Vehicles({"a": 100.0, "b": 200.0, "c": 150.0})
    headways = LocalHeadways(sumo, load_network("us101").road, ((100.0, 1.0), (200.0, 1.2)))
    for name in sumo.places:
        headways.add(name, 1.5)
    headways.apply()
    assert sumo.tau == pytest.approx({"a": 1.5, "b": 1.8, "c": 1.65})


def test_without_a_profile_headways_are_left_alone():
    sumo = Vehicles({"a": 100.0})
    headways = LocalHeadways(sumo, load_network("us101").road, ())
    headways.add("a", 1.5)
    headways.apply()
    assert sumo.tau == {}


def test_late_vehicles_take_the_route_of_their_lane_and_early_ones_keep_theirs():
    off, on = ("auxiliary", "off_ramp"), ("auxiliary", "downstream", "outflow")
    routes = {"missed": off, "stuck": on, "leaving": off, "passing": on, "early": off}
    sumo = Vehicles(
        {"missed": 200.0, "stuck": 200.0, "leaving": 200.0, "passing": 200.0, "early": 100.0},
        lanes={"missed": 1, "stuck": 0, "leaving": 0, "passing": 3, "early": 2},
        routes=dict(routes),
    )
    divert_late_vehicles(sumo, load_network("us101"))
    assert tuple(sumo.routes["missed"]) == on
    assert tuple(sumo.routes["stuck"]) == off
    assert all(sumo.routes[name] == routes[name] for name in ("leaving", "passing", "early"))
