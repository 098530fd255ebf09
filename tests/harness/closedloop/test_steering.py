"""Contacts of bodies, and how a provoked vehicle brakes."""

from types import SimpleNamespace

import numpy as np
import pytest

from harness.closedloop.episode_start import EpisodeStart
from harness.closedloop.plan import BRAKE
from harness.closedloop.routes import MainRoadRoute
from harness.closedloop.steering import STANDS_S, Steering, overlaps
from mmpf.map.corridor_road import highway
from tests.harness.closedloop.frames import frame_of

STEP_S, ROAD = 0.1, highway()


class VehicleApi:
    """Does at once what it is told to."""

    def __init__(self, speeds):
        self.speeds, self.freed = dict(speeds), []

    def getIDList(self):  # noqa: N802
        return tuple(self.speeds)

    def getSpeed(self, name):  # noqa: N802
        return self.speeds[name]

    def setSpeed(self, name, speed):  # noqa: N802
        if speed < 0.0:
            self.freed.append(name)
        else:
            self.speeds[name] = speed

    def setSpeedMode(self, name, mode):  # noqa: N802
        pass

    setLaneChangeMode = setSpeedMode  # noqa: N815


def steering(collisions=(), **speeds):
    vehicle = VehicleApi(speeds)
    sumo = SimpleNamespace(vehicle=vehicle, simulation=SimpleNamespace(getCollisions=lambda: collisions))
    return vehicle, Steering(sumo, EpisodeStart(BRAKE, "ego", "other", 1, 1, (), MainRoadRoute()))


def test_a_provoked_vehicle_stands_after_its_speed_over_five_seconds_and_is_let_go_after_one_more():
    vehicle, hands = steering(ego=10.0, other=12.0)
    hands.take_over()
    speeds = []
    while not vehicle.freed:
        hands.act(0.0, 10.0, STEP_S)
        speeds.append(vehicle.speeds["other"])
    stands = next(step for step, speed in enumerate(speeds) if speed == 0.0)
    assert (stands + 1) * STEP_S == pytest.approx(12.0 / 5.0, abs=STEP_S)
    assert np.diff(speeds[:stands]) == pytest.approx(-5.0 * STEP_S)
    assert (len(speeds) - stands) * STEP_S == pytest.approx(STANDS_S, abs=2.1 * STEP_S)


def test_the_ego_does_what_is_demanded_and_never_drives_backwards():
    vehicle, hands = steering(ego=1.0, other=5.0)
    hands.act(2.0, 1.0, STEP_S)
    assert vehicle.speeds["ego"] == pytest.approx(1.2)
    hands.act(-9.0, 0.5, STEP_S)
    assert vehicle.speeds["ego"] == 0.0


def test_bodies_overlap_where_a_plain_loop_over_corners_finds_a_common_point():
    rng = np.random.default_rng(4)
    frame = frame_of(lon=rng.uniform(-8.0, 8.0, 300), lat=rng.uniform(-4.0, 4.0, 300))
    found = overlaps(frame)
    for k in range(300):
        lon, lat = frame.lon_m[k] - frame.lon_m[0], frame.lat_m[k] - frame.lat_m[0]
        covers = all(
            max(-0.5 * own, off - 0.5 * other) < min(0.5 * own, off + 0.5 * other)
            for off, own, other in (
                (lon, frame.length_m[0], frame.length_m[k]),
                (lat, frame.width_m[0], frame.width_m[k]),
            )
        )
        assert found[k] == (covers and k != 0)


def test_bodies_in_the_plane_overlap_where_a_point_of_one_lies_in_the_other():
    rng = np.random.default_rng(6)
    turned = rng.uniform(-np.pi, np.pi, 200)
    frame = frame_of(rng.uniform(-5.0, 5.0, 200), rng.uniform(-5.0, 5.0, 200), direction_rad=turned)
    found = overlaps(frame)
    along, across = (each.ravel() for each in np.meshgrid(np.linspace(-2.25, 2.25, 91), np.linspace(-0.9, 0.9, 37)))

    def points(k):
        cosine, sine = np.cos(turned[k]), np.sin(turned[k])
        return frame.lon_m[k] + cosine * along - sine * across, frame.lat_m[k] + sine * along + cosine * across

    x, y = points(0)
    for k in range(1, 200):
        off_x, off_y = x - frame.lon_m[k], y - frame.lat_m[k]
        own = np.abs(off_x * np.cos(turned[k]) + off_y * np.sin(turned[k])) - 2.25
        side = np.abs(off_y * np.cos(turned[k]) - off_x * np.sin(turned[k])) - 0.9
        inside = np.maximum(own, side).min()
        # Between the points of the grid nothing is known.
        assert found[k] == (inside < 0.0) or abs(inside) < 0.05
    assert not found[0]


def test_who_crosses_is_hit_at_the_difference_of_both_velocities():
    _, hands = steering(ego=0.0, other=0.0)
    crossing = frame_of([0.0, 2.0], [0.0, 1.0], [3.0, 4.0], direction_rad=[0.0, 0.5 * np.pi])
    contact = hands.contact(crossing, 1.0)
    assert (contact.impact_mps, contact.into) == (pytest.approx(5.0), True)


def test_a_contact_tells_with_whom_how_hard_and_who_ran_into_whom():
    _, hands = steering(ego=0.0, other=0.0)
    ahead = frame_of(lon=[0.0, 4.0], lat=[0.0, 0.5], speed=[9.0, 2.0])
    contact = hands.contact(ahead, 1.5)
    assert (contact.vehicle_id, contact.time_s, contact.impact_mps, contact.into) == ("v1", 1.5, 7.0, True)
    behind = frame_of(lon=[0.0, -4.0], lat=[0.0, 0.5], speed=[2.0, 9.0])
    assert not hands.contact(behind, 1.5).into
    assert hands.contact(frame_of(lon=[0.0, 6.0], lat=[0.0, 0.0]), 1.5) is None


def test_what_sumo_reports_is_a_contact_though_the_bodies_seem_apart():
    collision = SimpleNamespace(collider="v0", victim="v1")
    _, hands = steering((collision,), v0=0.0)
    hands._at = EpisodeStart(BRAKE, "v0", "v1", 1, 1, (), MainRoadRoute())
    assert hands.contact(frame_of(lon=[0.0, 5.0], lat=[0.0, 0.0]), 1.0).vehicle_id == "v1"
