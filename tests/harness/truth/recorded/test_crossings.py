"""Recordings of roads that lead several ways: lanelets as lanes in the plane, and vehicles as they drove on them."""

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.lab.fidelity.samples import recorded_samples
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.storage import run_folder as runfolder
from mmpf.map.control import FREE, SIGNAL, YIELD
from mmpf.map.lane_graph import NOWHERE
from mmpf.numerics.arrays import wrapped
from tests.harness.truth.recorded.crossing import (
    DRIVERS,
    ENTRY,
    FOLLOW,
    LEFT_TURNER,
    NUMBER,
    ONCOMING,
    STRAIGHT_ON,
    WIDTH_M,
    write_crossing,
)
from tests.harness.truth.recorded.layouts import opened, write_commonroad

pytestmark = pytest.mark.usefixtures("read_here")

ECHO = "tests.harness.stand_ins:echo_tracker"
# Places from -60 m on are counted from a whole kilometre below.
ORIGIN_M = 1000.0
LANES = {str(number): name for name, number in NUMBER.items()}


@pytest.fixture(scope="module")
def crossing(tmp_path_factory):
    return opened(write_crossing(tmp_path_factory.mktemp("crossing") / "t.xml"))


@pytest.fixture(scope="module")
def graph(crossing):
    return crossing.road.graph


def lane_of(graph, name):
    return graph.name.index(str(NUMBER[name]))


def poses(frame, name):
    row = list(frame.vehicle_id).index(str(name))
    return frame.lon_m[row], frame.lat_m[row], frame.heading_rad[row], row


def test_each_lane_leads_to_those_that_the_file_names_and_begins_where_it_ends(graph):
    for name in NUMBER:
        k = lane_of(graph, name)
        after = graph.successor[graph.first_successor[k] : graph.first_successor[k + 1]]
        assert {LANES[graph.name[to]] for to in after} == set(FOLLOW.get(name, ()))
        for to in after:
            end, begin = graph.xy[graph.first_point[k + 1] - 1], graph.xy[graph.first_point[to]]
            assert np.hypot(*(end - begin)) < 0.01


def test_beside_a_lane_are_those_that_lead_the_same_way_alone(graph):
    left, right = lane_of(graph, "w_in_left"), lane_of(graph, "w_in_right")
    assert (graph.right[left], graph.left[right]) == (right, left)
    others = np.delete(np.arange(len(graph)), [left, right])
    assert (graph.left[others] == NOWHERE).all()
    assert (graph.right[others] == NOWHERE).all()
    assert graph.left[left] == NOWHERE


def test_lanes_have_their_width_and_the_limits_that_are_stated(graph):
    np.testing.assert_allclose(graph.width_m, WIDTH_M, atol=0.1)
    assert graph.speed_limit_mps[lane_of(graph, "e_in")] == 13.9
    assert graph.speed_limit_mps[lane_of(graph, "w_out")] > 30.0


def test_paths_across_the_crossing_are_told_from_its_arms(graph):
    inside = {LANES[graph.name[k]] for k in np.flatnonzero(graph.in_junction)}
    assert inside == set(ENTRY)


def test_without_signs_and_lights_nothing_is_said_of_right_of_way(graph):
    assert graph.control is None


def test_vehicles_are_where_the_file_has_them_and_speeds_are_along_their_headings(crossing):
    for frame in crossing.frames():
        for driver in DRIVERS:
            x, y, heading, row = poses(frame, driver.name)
            wanted = driver.pose_at(frame.time_s)
            assert (x, y) == pytest.approx((wanted[0] + ORIGIN_M, wanted[1] + ORIGIN_M), abs=1e-5)
            assert wrapped(np.array(heading - wanted[2])) == pytest.approx(0.0, abs=1e-6)
            assert frame.speed_mps[row] == pytest.approx(driver.speed_mps, abs=1e-6)
            assert frame.lat_speed_mps[row] == pytest.approx(0.0, abs=0.05)
            assert frame.accel_mps2[row] == pytest.approx(0.0, abs=1e-6)
            assert frame.direction_rad[row] == heading


@pytest.mark.parametrize("driver", DRIVERS)
def test_a_vehicle_drives_along_lanes_that_lead_to_one_another(driver, crossing):
    lanes = []
    for frame in crossing.frames():
        lane = frame.lane[poses(frame, driver.name)[3]]
        if not lanes or lanes[-1] != lane:
            lanes.append(lane)
    way = tuple(LANES[crossing.road.graph.name[lane - 1]] for lane in lanes)
    assert way == driver.way[: len(way)]
    assert len(way) > 1


def test_between_rows_a_turning_vehicle_stays_on_its_arc(tmp_path):
    """Rows lie two steps of the clock apart; westward headings are where angles jump by a whole turn."""
    truth = opened(write_crossing(tmp_path / "slow.xml", drivers=(LEFT_TURNER, ONCOMING), step_s=0.2, seconds=6.0))
    for frame in truth.frames():
        for driver in (LEFT_TURNER, ONCOMING):
            x, y, heading, _ = poses(frame, driver.name)
            wanted = driver.pose_at(frame.time_s)
            assert (x - ORIGIN_M, y - ORIGIN_M) == pytest.approx(wanted[:2], abs=0.01)
            assert wrapped(np.array(heading - wanted[2])) == pytest.approx(0.0, abs=0.03)


def test_coordinates_far_from_the_origin_become_small_ones(tmp_path):
    near, far = (
        opened(write_crossing(tmp_path / f"{k}.xml", shift=shift))
        for k, shift in enumerate(((500.0, 500.0), (690_500.0, 5_335_500.0)))
    )
    np.testing.assert_allclose(near.road.graph.xy, far.road.graph.xy, atol=2e-3)
    np.testing.assert_allclose(near.traffic.columns["lat_m"], far.traffic.columns["lat_m"], atol=1e-5)


def test_one_straight_road_keeps_its_own_frame_and_a_bend_is_in_the_plane(tmp_path):
    assert opened(write_commonroad(tmp_path / "straight.xml")).road.graph is None
    ways = {"e_in", "e to s", "s_out"}
    path = write_crossing(tmp_path / "bend.xml", drivers=(LEFT_TURNER,))
    text = path.read_text()
    for name in set(NUMBER) - ways:
        begin = text.index(f'<lanelet id="{NUMBER[name]}"')
        text = text[:begin] + text[text.index("</lanelet>", begin) + len("</lanelet>") :]
    path.write_text(text)
    assert len(opened(path).road.graph) == 3


def sign(number, kind, value=""):
    value = f"<additionalValue>{value}</additionalValue>" if value else ""
    element = f"<trafficSignElement><trafficSignID>{kind}</trafficSignID>{value}</trafficSignElement>"
    return f'<trafficSign id="{number}">{element}</trafficSign>'


def test_signs_say_how_fast_and_who_waits_for_whom(tmp_path):
    at = {"s_in": '<trafficSignRef ref="9001"/>', "w_in_left": '<trafficSignRef ref="9002"/>'}
    path = write_crossing(tmp_path / "t.xml", in_lanelet=at, extra=sign(9001, "205") + sign(9002, "274", "12.5"))
    graph = opened(path).road.graph
    assert graph.speed_limit_mps[lane_of(graph, "w_in_left")] == 12.5
    waits = {k for k in range(len(graph.successor)) if graph.control.kind[k] == YIELD}
    assert {graph.name[graph.link_from[k]] for k in waits} == {str(NUMBER["s_in"])}
    assert set(graph.control.kind) == {FREE, YIELD}
    foes = {}
    for k in waits:
        own = graph.control.foe[graph.control.first_foe[k] : graph.control.first_foe[k + 1]]
        foes[LANES[graph.name[graph.successor[k]]]] = {LANES[graph.name[graph.successor[foe]]] for foe in own}
    assert foes == {"s to e": {"w to e"}, "s to w": {"w to e", "e to w", "e to s"}}


def test_traffic_lights_are_signals_of_the_links_behind_them(tmp_path):
    at = {name: f'<trafficLightRef ref="{number}"/>' for name, number in (("e_in", 71), ("s_in", 72))}
    graph = opened(write_crossing(tmp_path / "t.xml", in_lanelet=at)).road.graph
    held = {LANES[graph.name[graph.link_from[k]]] for k in np.flatnonzero(graph.control.kind == SIGNAL)}
    assert held == {"e_in", "s_in"}
    assert len(graph.control.signal_name) == 4


def test_footpaths_are_no_lanes_and_a_scenario_of_them_alone_is_refused(tmp_path):
    foot = "<laneletType>sidewalk</laneletType>"
    graph = opened(write_crossing(tmp_path / "some.xml", in_lanelet={"s_out": foot})).road.graph
    assert str(NUMBER["s_out"]) not in graph.name
    with pytest.raises(InputError, match=r"all\.xml: no lanelet of it is for cars"):
        opened(write_crossing(tmp_path / "all.xml", in_lanelet=dict.fromkeys(NUMBER, foot)))


def test_vehicles_that_move_less_far_than_they_say_are_refused_whatever_their_direction(tmp_path):
    path = write_crossing(tmp_path / "t.xml")
    path.write_text(path.read_text().replace("<exact>8.0</exact></velocity>", "<exact>28.8</exact></velocity>"))
    with pytest.raises(InputError, match=r"vehicle 1 moves .40\.\d m while its speed says .144\.\d m"):
        opened(path)


def test_the_ego_in_the_middle_goes_first(tmp_path):
    truth = opened(write_crossing(tmp_path / "t.xml"))
    assert [str(truth.traffic.names[ego.stay]) for ego in truth.egos] == [str(LEFT_TURNER.name)]


def test_a_crossing_is_driven_and_replayed_with_the_same_bytes(tmp_path):
    path = write_crossing(tmp_path / "t.xml")
    first = run(resolve_run_config(options={"replay": str(path), "tracker": ECHO, "ego": "each:2"}), out=tmp_path / "a")
    assert first.metrics["manoeuvre"]["left"]["n"] > 0
    path.unlink()
    again = run(resolve_run_config(options={"replay": str(first.folder), "tracker": ECHO}), out=tmp_path / "b")
    assert (first.folder / runfolder.TRUTH).read_bytes() == (again.folder / runfolder.TRUTH).read_bytes()
    for scores in ("mae", "mot", "mot_all", "gospa"):
        assert first.metrics[scores] == again.metrics[scores]


def test_mmpf_follows_all_vehicles_across_the_crossing(tmp_path):
    path = write_crossing(tmp_path / "t.xml", drivers=(STRAIGHT_ON, ONCOMING, LEFT_TURNER))
    options = {"replay": str(path), "tracker": "mmpf", "model": "gmm", "ego": str(STRAIGHT_ON.name), "sensor": "ideal"}
    metrics = run(resolve_run_config(options=options), out=tmp_path / "run").metrics
    assert metrics["mot"]["id_switches"] == 0
    assert metrics["mae"]["visible"]["speed_mps"] < 0.5


def test_what_needs_one_road_refuses_a_crossing_in_one_line(tmp_path):
    path = write_crossing(tmp_path / "t.xml")
    with pytest.raises(InputError, match=r"t\.xml: .*one road"):
        recorded_samples([path], "us101")
