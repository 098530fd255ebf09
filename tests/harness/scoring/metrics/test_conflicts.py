"""TTC, DRAC and PET: against closed forms, and against SUMO's own device on the same trajectories."""

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from harness.decisions.bodies import Bodies, Egos
from harness.scoring.driving.encroachment import post_encroachment_times
from harness.scoring.metrics.conflicts import deceleration_to_avoid, time_to_collision

NET = """<net version="1.16"><location netOffset="0,0" convBoundary="0,0,2000,0" origBoundary="0,0,2000,0"
 projParameter="!"/><edge id="e" from="a" to="b" priority="1"><lane id="e_0" index="0" speed="50" length="2000"
 shape="0,0 2000,0"/></edge><junction id="a" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,0"/>
<junction id="b" type="dead_end" x="2000" y="0" incLanes="e_0" intLanes="" shape="2000,0"/></net>"""
ROUTES = """<routes><vType id="car" length="5" minGap="2.5" sigma="0" accel="2.6" decel="4.5"/><route id="r" edges="e"/>
<vehicle id="leader" type="car" route="r" depart="0" departPos="100" departSpeed="20"/>
<vehicle id="ego" type="car" route="r" depart="0" departPos="20" departSpeed="20">
<param key="has.ssm.device" value="true"/><param key="device.ssm.measures" value="TTC DRAC"/>
<param key="device.ssm.thresholds" value="30.0 0.05"/><param key="device.ssm.trajectories" value="true"/>
<param key="device.ssm.range" value="200"/><param key="device.ssm.file" value="{log}"/></vehicle></routes>"""


def test_closed_forms():
    gap, speed, leader = np.array([20.0, 20.0, np.inf, -1.0]), np.full(4, 15.0), np.array([10.0, 15.0, 0.0, 10.0])
    assert time_to_collision(gap, speed, leader).tolist() == [4.0, np.inf, np.inf, 0.0]
    assert deceleration_to_avoid(gap, speed, leader).tolist() == [0.625, 0.0, 0.0, np.inf]


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Return times, gaps and both speeds of a drive, and SUMO's TTC and DRAC of it by time."""
    libsumo = pytest.importorskip("libsumo")
    folder = tmp_path_factory.mktemp("ssm")
    (folder / "net.xml").write_text(NET)
    (folder / "rou.xml").write_text(ROUTES.format(log=folder / "ssm.xml"))
    words = ["sumo", "-n", str(folder / "net.xml"), "-r", str(folder / "rou.xml"), "--step-length", "0.1"]
    libsumo.start([*words, "--no-step-log", "true", "--no-warnings", "true", "--step-method.ballistic", "true"])
    rows = []
    for step in range(200):
        libsumo.simulationStep()
        if step == 20:
            libsumo.vehicle.setSpeed("leader", 6.0)
        if step == 120:
            libsumo.vehicle.setSpeed("leader", 14.0)
        front = [libsumo.vehicle.getLanePosition(name) for name in ("ego", "leader")]
        speeds = [libsumo.vehicle.getSpeed(name) for name in ("ego", "leader")]
        rows.append((libsumo.simulation.getTime(), front[1] - 5.0 - front[0], *speeds))
    libsumo.close()
    found = {"TTC": {}, "DRAC": {}}
    for conflict in ET.parse(folder / "ssm.xml").getroot().iter("conflict"):
        times = conflict.find("timeSpan").get("values").split()
        for name, values in found.items():
            listed = conflict.find(f"{name}Span").get("values").split()
            values.update({
                round(float(time), 1): float(value)
                for time, value in zip(times, listed, strict=True)
                if value != "NA"
            })  # fmt: skip
    return np.array(rows), found


@pytest.mark.parametrize("name", ["TTC", "DRAC"])
def test_they_are_those_of_sumos_device_within_one_per_cent(both, name):
    rows, found = both
    time_s, gap, speed, leader = rows.T
    ours = {"TTC": time_to_collision, "DRAC": deceleration_to_avoid}[name](gap, speed, leader)
    # Sumo stamps what it measures with the time at which the step began.
    at = {round(float(time) - 0.1, 1): value for time, value in zip(time_s, ours, strict=True)}
    # It writes two decimals, so that smaller values say less than a hundredth.
    common = [time for time, value in found[name].items() if time in at and value >= 0.5]
    assert len(common) > 50
    assert [at[time] for time in common] == pytest.approx([found[name][time] for time in common], rel=0.01)


class Rows:
    """What is used of a run's rows."""

    def __init__(self, time_s, vehicle):
        self.time_s, self.has_headings = time_s, True
        self.truth = type("Truth", (), {"vehicle": vehicle})


TIME_S = np.arange(0.0, 12.0, 0.1)


def crossing_ego():
    """The ego crosses the origin along x at 10 m/s after 5 s."""
    n = len(TIME_S)
    return Egos(
        np.zeros(n, np.int64), -50.0 + 10.0 * TIME_S, np.zeros(n), np.full(n, 10.0), np.ones(n, np.int64),
        np.full(n, 4.0), np.full(n, 2.0),
    )  # fmt: skip


def encounter(others_start_m, speed=10.0, lag=0.0, direction=0.5 * np.pi):
    """Another vehicle comes along a direction to where the ego crosses."""
    egos = crossing_ego()
    n = len(egos)
    along = others_start_m + speed * (TIME_S - lag)
    bodies = Bodies(
        np.arange(n), along * np.cos(direction), along * np.sin(direction), np.full(n, speed),
        np.full(n, direction), np.full(n, 4.0), np.full(n, 2.0),
    )  # fmt: skip
    return post_encroachment_times(egos, bodies, Rows(TIME_S, np.zeros(n, np.int64))).tolist()


@pytest.mark.parametrize(("start_m", "time_s"), [(-80.0, 3.0 - 0.6), (-30.0, 2.0 - 0.6), (-50.0, 0.0)])
def test_the_second_comes_as_long_after_the_first_as_their_bodies_leave_room_whichever_goes_first(start_m, time_s):
    """The middles are at the crossing so long apart; both bodies cover it for 0.6 s, half of it before and after."""
    assert encounter(start_m) == [pytest.approx(time_s)]


def test_an_oblique_crossing_is_a_longer_one():
    angle = np.deg2rad(45.0)
    reach = 0.5 * (4.0 + (2.0 + 2.0 * np.cos(angle)) / np.sin(angle))
    assert encounter(-80.0, direction=angle) == [pytest.approx(3.0 - 2.0 * reach / 10.0)]


def test_who_does_not_come_to_the_crossing_or_goes_along_has_no_encounter():
    assert encounter(-200.0) == []
    assert encounter(-60.0, direction=0.0) == []
    assert encounter(-60.0, direction=np.deg2rad(10.0)) == []


def test_vehicles_that_never_come_near_are_passed_over_and_those_after_them_are_not():
    egos = crossing_ego()
    n = len(egos)
    crossing = -80.0 + 10.0 * TIME_S
    lon = np.concatenate([np.full(n, 500.0), np.zeros(n), np.full(n, 20.0)])
    lat = np.concatenate([np.full(n, 500.0), crossing, crossing])
    body = np.full(3 * n, 4.0)
    bodies = Bodies(np.tile(np.arange(n), 3), lon, lat, body, np.full(3 * n, 0.5 * np.pi), body, 0.5 * body)
    found = post_encroachment_times(egos, bodies, Rows(TIME_S, np.repeat([0, 1, 2], n)))
    # The ego comes to the second crossing 2 s after the first, so that it is met there sooner after.
    assert found.tolist() == pytest.approx([3.0 - 0.6, 1.0 - 0.6])
