"""Truth on a crossing: every vehicle around the ego is there, nothing jumps, and speeds are along headings."""

import itertools
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.truth.network.lanegraph import PlaneNetwork
from harness.truth.network.network import load_network
from harness.truth.sumo.plane_reading import pulled
from harness.truth.sumo.plane_traffic import PlaneTraffic
from harness.truth.sumo.simulation import SumoTruth, open_traffic
from harness.truth.sumo.smoothing import hann_weights
from tests.mmpf.map.scenes import graph_of

NET = Path(__file__).parents[1] / "network" / "nets" / "crossing.net.xml"
WAYS = [(a, b) for a, b in itertools.product("ewns", repeat=2) if a != b]


def configured(folder, vehicles):
    """Write a configuration of the crossing and return its path."""
    (folder / "own.rou.xml").write_text(f"<routes>{vehicles}</routes>")
    (folder / "own.sumocfg").write_text(
        f'<configuration><net-file value="{NET}"/><route-files value="own.rou.xml"/></configuration>'
    )
    return str(folder / "own.sumocfg")


def everybody():
    """Return flows from everywhere to everywhere, and bicycles on the path."""
    flows = "".join(
        f'<flow id="{a}{b}" from="{a}c" to="c{b}" begin="0" end="300" vehsPerHour="150" departSpeed="max"/>'
        for a, b in WAYS
    )
    bicycles = '<vType id="bike" vClass="bicycle"/><flow id="b" type="bike" from="path" to="path" begin="0" end="300" '
    return bicycles + f'number="30"/>{flows}'


def drive(path, duration_s=20.0, on_frame=lambda *_: None):
    truth = open_traffic(load_network(path), duration_s=duration_s, seed=1, on_step=lambda: None)
    try:
        frames = []
        for frame in truth.frames():
            on_frame(truth, frame)
            frames.append(frame)
        return truth.road, frames
    finally:
        truth.close()


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """Return the road, the frames, and where SUMO itself had whom at each of its steps."""
    places = {}
    reached = []

    def listen(truth, _):
        reached.append(truth.running.sumo.simulation.getTime())
        if len(places) == 0:
            advance = truth.running.advance

            def advance_and_note():
                advance()
                note(truth.running.sumo)

            truth.running.advance = advance_and_note
        note(truth.running.sumo)

    def note(sumo):
        ids = sumo.vehicle.getIDList()
        places[round(sumo.simulation.getTime(), 1)] = {name: sumo.vehicle.getPosition(name) for name in ids}

    road, frames = drive(configured(tmp_path_factory.mktemp("crossing"), everybody()), on_frame=listen)
    return road, frames, reached, places


def pairs(frames):
    for before, after in itertools.pairwise(frames):
        _, first, second = np.intersect1d(before.vehicle_id, after.vehicle_id, return_indices=True)
        yield before, after, first, second


def velocity(frame, rows):
    cosine, sine = np.cos(frame.heading_rad[rows]), np.sin(frame.heading_rad[rows])
    speed, left = frame.speed_mps[rows], frame.lat_speed_mps[rows]
    return np.stack([speed * cosine - left * sine, speed * sine + left * cosine])


def test_all_of_sumos_own_vehicles_around_the_ego_are_in_the_frame(driven):
    _, frames, reached, places = driven
    compared = 0
    for frame, now_s in zip(frames, reached, strict=True):
        at = places.get(round(now_s - 0.6, 1))
        if at is None:
            continue
        ego = np.array(at[str(frame.vehicle_id[frame.ego])])
        near = {name for name, place in at.items() if np.hypot(*(np.array(place) - ego)) < 140.0}
        there = set(frame.vehicle_id.tolist())
        assert near <= there <= set(at)
        compared += len(near)
    assert compared > 2000
    assert any(str(name).startswith("b.") for frame in frames for name in frame.vehicle_id)


def test_positions_are_sumos_less_half_a_length_along_the_heading_where_driving_is_straight(driven):
    _, frames, reached, places = driven
    errors = []
    for frame, now_s in zip(frames, reached, strict=True):
        at = [places.get(round(now_s - 0.6 + 0.1 * k, 1), {}) for k in range(-5, 6)]
        straight = np.flatnonzero((np.abs(np.sin(2.0 * frame.heading_rad)) < 1e-3) & (frame.lane > 0))
        for row in straight:
            name = str(frame.vehicle_id[row])
            if all(name in there for there in at):
                front = hann_weights(5) @ np.array([there[name] for there in at])
                half = 0.5 * frame.length_m[row]
                centre = front - half * np.array([np.cos(frame.heading_rad[row]), np.sin(frame.heading_rad[row])])
                errors.append(np.hypot(*(centre - (frame.lon_m[row], frame.lat_m[row]))))
    assert len(errors) > 500
    assert max(errors) < 0.02


def test_positions_are_the_integral_of_speeds_and_nobody_drives_backwards(driven):
    _, frames, _, _ = driven
    for before, after, a, b in pairs(frames):
        moved = np.stack([after.lon_m[b] - before.lon_m[a], after.lat_m[b] - before.lat_m[a]])
        assert np.allclose(moved, 0.05 * (velocity(before, a) + velocity(after, b)), atol=0.02)
    assert min(frame.speed_mps.min() for frame in frames) >= 0.0


def test_headings_turn_as_cars_do_and_lead_along_the_lanes(driven):
    road, frames, _, _ = driven
    for before, after, a, b in pairs(frames):
        turn = np.abs(np.remainder(after.heading_rad[b] - before.heading_rad[a] + np.pi, 2.0 * np.pi) - np.pi)
        assert np.degrees(turn).max() < 10.0
    for frame in frames[::10]:
        on = np.flatnonzero(frame.lane > 0)
        _, left, direction = road.graph.on_lane(frame.lane[on] - 1, frame.lon_m[on], frame.lat_m[on])
        off = np.abs(np.remainder(direction - frame.heading_rad[on] + np.pi, 2.0 * np.pi) - np.pi)
        open_road = ~road.graph.in_junction[frame.lane[on] - 1]
        assert np.median(off) < 0.05
        assert np.abs(left[open_road]).max() < 3.3


def test_vehicles_of_all_four_directions_are_seen(driven):
    _, frames, _, _ = driven
    headings = np.concatenate([frame.heading_rad for frame in frames])
    assert all(
        (np.abs(np.remainder(headings - way + np.pi, 2 * np.pi) - np.pi) < 0.1).any() for way in np.arange(4) * 1.5708
    )


def test_the_ego_is_a_car_that_stays_until_its_journey_ends(driven):
    road, frames, _, _ = driven
    episodes = np.array([frame.episode for frame in frames])
    assert episodes[0] == 0
    assert set(np.diff(episodes)) <= {0, 1}
    assert episodes[-1] >= 1
    for episode in range(episodes[-1]):
        last = frames[int(np.flatnonzero(episodes == episode)[-1])]
        assert not str(last.vehicle_id[last.ego]).startswith("b.")
        leaves = road.graph.name[last.lane[last.ego] - 1]
        assert leaves.startswith("c")


def test_same_seed_same_frames(tmp_path):
    path = configured(tmp_path, everybody())
    first, second = (drive(path, duration_s=1.0)[1][-1] for _ in range(2))
    assert np.array_equal(first.lon_m, second.lon_m)
    assert np.array_equal(first.heading_rad, second.heading_rad)


def test_parked_vehicles_are_left_out_and_those_that_stop_on_the_road_are_not(tmp_path):
    def stopped(name, parking):
        stop = f'<stop lane="ec_0" startPos="20" endPos="60" duration="500" parking="{parking}"/>'
        return f'<trip id="{name}" from="ec" to="cw" depart="0" departLane="0" departPos="40">{stop}</trip>'

    flow = '<flow id="f" from="wc" to="ce" begin="1" end="300" vehsPerHour="900"/>'
    stops = stopped("parked", "true") + stopped("stands", "false").replace('"40"', '"20"').replace('"60"', '"50"')
    _, frames = drive(configured(tmp_path, stops + flow), duration_s=5.0)
    names = {str(name) for frame in frames for name in frame.vehicle_id}
    assert "stands" in names
    assert "parked" not in names


def test_a_network_without_cars_fails_in_words(tmp_path, monkeypatch):
    monkeypatch.setattr("harness.truth.sumo.plane_traffic.FIRST_VEHICLE_WITHIN_S", 5.0)
    bicycle = '<vType id="bike" vClass="bicycle"/><flow id="b" type="bike" from="path" to="path"'
    bicycles = f'{bicycle} begin="0" end="9" number="9"/>'
    with pytest.raises(InputError, match="no car drove on"):
        drive(configured(tmp_path, bicycles))


def test_on_a_circle_the_rear_axle_runs_inside_as_the_tractrix_says():
    radius_m, arm_m, step = 12.0, 4.0, 0.005
    front, rear = (radius_m, 0.0), (radius_m, -arm_m)
    for k in range(1, 4000):
        ahead = (radius_m * np.cos(k * step), radius_m * np.sin(k * step))
        rear = pulled(front, rear, ahead, arm_m)
        front = ahead
    assert np.hypot(*rear) == pytest.approx(np.sqrt(radius_m**2 - arm_m**2), abs=0.02)
    assert np.hypot(front[0] - rear[0], front[1] - rear[1]) == pytest.approx(arm_m)


def test_a_jump_to_the_next_lane_does_not_turn_the_body():
    assert pulled((0.0, 0.0), (-4.0, 0.0), (0.0, 3.2), 4.0) == pytest.approx((-4.0, 3.2))


@pytest.fixture(scope="module")
def walked(tmp_path_factory):
    """Return the road, the frames, where SUMO has persons, and which of them ride; walkers are called as cars are."""
    flow = '<flow id="we" from="wc" to="ce" begin="0" end="600" period="3" departSpeed="max"/>'
    walking = (
        '<personFlow id="we" begin="0" end="600" period="8"><walk from="path" to="path" arrivalPos="-1"/></personFlow>'
    )
    riding = "".join(
        f'<vehicle id="taxi{k}" depart="{4 * k}" departLane="best"><route edges="wc ce"/></vehicle>'
        f'<person id="rider{k}" depart="triggered"><ride from="wc" to="ce" lines="taxi{k}"/></person>'
        for k in range(1, 150)
    )
    places, riders = [], set()

    def note(truth, _):
        person = truth.running.sumo.person
        places.append({name: person.getPosition(name) for name in person.getIDList()})
        riders.update(name for name in places[-1] if person.getVehicle(name))

    road, frames = drive(configured(tmp_path_factory.mktemp("walked"), walking + riding + flow), 15.0, note)
    return road, frames, places, riders


def test_persons_on_foot_are_in_the_frame_as_a_type_of_their_own(walked):
    _, frames, places, riders = walked
    seen = 0
    for frame, at in zip(frames, places, strict=True):
        for row in np.flatnonzero(frame.pedestrian):
            name = str(frame.vehicle_id[row])
            assert name.startswith("person:")
            now = at.get(name.removeprefix("person:"))
            if now is None:
                continue
            # A frame is made of half a second to either side of it: they have walked on by then.
            assert np.hypot(frame.lon_m[row] - now[0], frame.lat_m[row] - now[1]) < 1.5
            assert 0.0 <= frame.speed_mps[row] < 2.5
            assert max(frame.length_m[row], frame.width_m[row]) < 1.0
            assert frame.lane[row] == 0
            seen += 1
        assert not frame.pedestrian[frame.ego]
        assert not frame.pedestrian[frame.lane > 0].any()
        there = {str(name).removeprefix("person:") for name in frame.vehicle_id[frame.pedestrian]}
        assert there.isdisjoint(riders)
    assert seen > 500
    assert riders


class VehicleApi:
    """One car on a lane, 4 m long, whose front is at x = 20."""

    def __init__(self, angle=90.0):
        self.x, self.y, self.angle = 20.0, 0.0, angle

    def getIDList(self):  # noqa: N802
        return ("car",)

    def getPosition(self, name):  # noqa: N802
        return self.x, self.y

    def __getattr__(self, what):
        values = {
            "getLength": 4.0, "getWidth": 1.8, "getVehicleClass": "passenger", "getDeparture": 0.0,
            "getAngle": self.angle, "getSpeed": 7.0, "getAcceleration": -1.0, "getLaneID": "a_0",
            "isStoppedParking": False,
        }  # fmt: skip
        return lambda name: values[what]


def present_truth(vehicle):
    """Return the truth of one vehicle on its network, whose density would be held."""
    person = SimpleNamespace(getIDList=tuple)
    errors = {"TraCIException": RuntimeError, "FatalTraCIError": RuntimeError}
    sumo = SimpleNamespace(vehicle=vehicle, person=person, simulation=SimpleNamespace(getTime=lambda: 0.0), **errors)
    running = SimpleNamespace(sumo=sumo)
    plane = PlaneNetwork(graph_of({"a_0": [(0, 0), (100, 0)], "b_0": [(0, 0), (-100, 1)]}), (0.0, 0.0))
    held = SimpleNamespace(before_step=None)
    return SumoTruth(running, None, PlaneTraffic(running, None, plane, 150.0, held), 0, ego=False)


def test_at_present_a_car_is_where_its_middle_is_now_on_its_lane_as_fast_as_it_is():
    vehicle = VehicleApi()
    truth = present_truth(vehicle)
    for step in range(3):
        frame = truth.present(step)
        assert frame.lon_m[0] == pytest.approx(vehicle.x - 2.0)
        assert (frame.lane[0], frame.speed_mps[0], frame.direction_rad[0]) == (1, 7.0, 0.0)
        vehicle.x += 0.7
    assert frame.pedestrian is None


def test_at_present_a_heading_that_goes_round_is_not_averaged():
    vehicle = VehicleApi(angle=269.0)
    truth = present_truth(vehicle)
    headings = []
    for step in range(20):
        headings.append(truth.present(step).heading_rad[0])
        vehicle.x, vehicle.y = vehicle.x - 0.7, vehicle.y + 0.05
    assert headings[0] < 0.0 < headings[-1]
    assert min(np.abs(headings)) > np.radians(170.0)
