"""Networks from elsewhere: what would hang, crash or write files is refused or left out, before SUMO reads it."""

import os
import re
import shutil
from pathlib import Path

import pytest

from harness.common.errors import InputError
from harness.truth.network.limits import check_xml
from harness.truth.network.network import load_network
from harness.truth.sumo.simulation import open_traffic

pytestmark = pytest.mark.usefixtures("no_pictures")

US101 = Path(__file__).parents[4] / "networks" / "us101"
NET = (US101 / "us101.net.xml").read_text()
METADATA = (US101 / "network.toml").read_text()
ROUTE = "approach upstream auxiliary downstream outflow"
VEHICLES = f'<routes><route id="r" edges="{ROUTE}"/><flow id="f" route="r" begin="0" end="60" number="3"/></routes>'


def own(folder: Path, options: str = "", additional: str | None = None, net: str = NET, routes: str = VEHICLES) -> str:
    """Write a configuration of one's own with its files, and return its path."""
    (folder / "own.net.xml").write_text(net)
    (folder / "own.rou.xml").write_text(routes)
    if additional is not None:
        (folder / "own.add.xml").write_text(additional)
        options += '<additional-files value="own.add.xml"/>'
    path = folder / "own.sumocfg"
    path.write_text(
        f'<configuration><input><net-file value="own.net.xml"/><route-files value="own.rou.xml"/>{options}</input>'
        "</configuration>"
    )
    return str(path)


def replaced(name: str, value: str) -> str:
    """Return the network with one attribute of its first lane changed."""
    without = re.sub(rf'(<lane [^>]*) {name}="[^"]*"', r"\1", NET, count=1)
    return without.replace("<lane ", f'<lane {name}="{value}" ', 1)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("speed", "0"), ("speed", "-1"), ("speed", "nan"), ("speed", "1e9"), ("length", "nan"), ("length", "0"),
        ("index", "-1"), ("speed", "0x10000"), ("speed", "83"),
        ("length", "inf"), ("length", "-5"), ("width", "1e6"), ("width", "9"), ("width", "0"), ("width", "nan"),
        ("shape", "0,0 nan,3"), ("shape", "0,0 1e300,1"), ("shape", "a,b"), ("shape", "0,0 200,0 20,1 300,0"),
    ],
)  # fmt: skip
def test_a_lane_that_no_road_has_is_refused(name, value, tmp_path):
    with pytest.raises(InputError, match=r"own\.net\.xml"):
        load_network(own(tmp_path, net=replaced(name, value)))


NO_TYPE = (
    'length="1e9"; width="nan"; width="8"; tau="inf"; tau="9"; minGap="45"; speedDev="0x10"; lcAssertive="inf"; '
    'lcSpeedGain="-1e9"; maxSpeed="0x1p300"; maxSpeedLat="0.8f"; accel="0.01"; speedFactor="8"; color="1,nan,0"; '
    'speedFactor="normc(1,5,0.2,9)"; vClass="bicycle" length="12"; decel="0.1"; vClass="taxi" width="0.5"; tau="0.1"; '
    'emergencyDecel="2.9" decel="3.5"; lcKeepRight="0 m"; lcSpeedGain=""; sigmaleader="22"; tPersEstimate="330"'
)


@pytest.mark.parametrize(
    "routes",
    [
        *(VEHICLES.replace('number="3"', f'{name}="1e12"') for name in ("vehsPerHour", "number")),
        *(VEHICLES.replace("<route ", f'<vType id="t" {said}/><route ') for said in NO_TYPE.split("; ")),
        VEHICLES[:60],
        *(VEHICLES.replace("<flow ", f'<flow departSpeed="{speed}" ') for speed in ("2000000000", "nan")),
        *(f'<routes><{element} id="f" departSpeed="inf"/></routes>' for element in ("vehicle", "trip")),
        *(f"<routes{mark}</routes>" for mark in (' xmlns="x">', ' xmlns:a="x"><a:vType/>', '><include href="a.xml"/>')),
    ],
)
def test_vehicles_that_can_not_be_are_refused_in_one_line(routes, tmp_path):
    with pytest.raises(InputError, match=r"own\.rou\.xml"):
        load_network(own(tmp_path, routes=routes))


RED = '<tlLogic id="x" type="static" programID="0" offset="0"><phase duration="9" state="rr"/></tlLogic></net>'
GAP = '<lane id="a_0" shape="0,0 9,0"/><lane id=":v_0" shape="20,0 30,0"/><connection from="a" to="b" fromLane="0" '
APART = ('"upstream" to="auxiliary"', '"upstream" to="upstream"')


@pytest.mark.parametrize(("old", "new"), [APART, ("</net>", RED), ("</net>", f'{GAP} via=":v_0"/></net>')])
def test_connections_of_edges_that_do_not_meet_and_signals_that_stay_red_are_refused(old, new, tmp_path):
    (tmp_path / "a.net.xml").write_text(NET.replace(old, new))
    with pytest.raises(InputError, match=r"a\.net\.xml: (connection from (upstream to upstream|a to b)|tlLogic x)"):
        check_xml(tmp_path / "a.net.xml")


@pytest.mark.parametrize(
    ("name", "old", "new", "told"),
    [
        ("us101", r"(-450.*)5.490( .*)5.490", r"\g<1>9.490\g<2>9.490", "lane approach_1 is 7.66"),
        ("us101", r"(.*\n)(.*approach_1.*\n)", r"\2\1", "the lanes of edge approach are not in order"),
        ("us101", 'approach_1" index="1"', 'approach_1" index="0"', "lane approach_1 has the index 0"),
        ("us101", r'( id="exit".*) x="(\S+)" y="(\S+)"', r'\1 x="\3" y="\2"', "edge outflow is far from its"),
        ("us101", "<net ", '<net lefthand="true" ', "lane approach_1 lies on the wrong side of the one before it"),
        ("priority", "<net ", '<net lefthand="true" ', "traffic of most roads drives on the wrong side of"),
        ("us101", 'fromLane="0" toLane="0"', 'fromLane="0" toLane="3"', "connections from approach to upstream cross"),
        ("us101", 'incLanes="approach_0 ', 'incLanes="', "junction section_start names other lanes"),
        ("us101", '"M"', '"m"', "the states of 1 of 22 connections disagree"),
        ("priority", 'type="priority"', 'type="dead_end"', "lets some wait, but nobody by its type"),
        ("priority", 'foes="111', 'foes="000', "junction crossing lets some wait for no foe"),
        ("priority", 'via=":crossing_4_0"', 'via=":crossing_5_0"', "path :crossing_5_0"),
        ("junction", "rrrrGGGgrrrrGGGg", "rrrrGGGgrrrrGGGr", "signal 15 of tlLogic crossing is never green"),
        ("junction", "rrrrGGGgrrrrGGGg", "rGrrGGGgrrrrGGGg", "signals of tlLogic crossing are green for foes at once"),
    ],
)
def test_elements_of_a_network_that_contradict_each_other_are_told(name, old, new, told, tmp_path):
    text = (US101.parent / name / f"{name}.net.xml").read_text()
    (tmp_path / "a.net.xml").write_text(re.sub(old, new, text, count=1))
    assert told in "; ".join(check_xml(tmp_path / "a.net.xml"))


@pytest.mark.parametrize(
    ("place", "told"),
    [
        ('departPos="410" arrivalPos="-330"', []),
        ('departPos="410.1"', ["departPos of flow f is beyond the 410 m of edge approach"]),
        ('arrivalPos="-9999"', ["arrivalPos of flow f is beyond the 330 m of edge outflow"]),
        ('from="upstream" departPos="410"', ["departPos of flow f is beyond the 228 m of edge upstream"]),
    ],
)
def test_places_beyond_the_end_of_an_edge_to_which_sumo_moves_vehicles_are_told(place, told, tmp_path):
    (tmp_path / "a.rou.xml").write_text(VEHICLES.replace("<flow ", f"<flow {place} "))
    assert check_xml(US101 / "us101.net.xml", tmp_path / "a.rou.xml") == told


def test_colours_distributions_and_pavements_are_taken_and_what_is_unusual_is_told(tmp_path):
    lane = '<lane id=":w_0" allow="pedestrian" speed="1" length="3" width="12" shape="0,0 30,0 30,9 0,9"/>'
    types = '<vType id="a" color="1,0.5,0" speedFactor="norm(1,0)"/><vType id="b" color="red" vClass="bus" tau="3.5"/>'
    spike = '<lane id="b_0" speed="9" length="130" shape="0,0 40,0 20,1 90,0"/>'
    (tmp_path / "a.net.xml").write_text(f"<net>{lane}{spike}{types}</net>")
    assert check_xml(tmp_path / "a.net.xml") == ["lane b_0 doubles back", "tau of vType b is 3.5, 0.4 to 3 is usual"]


@pytest.mark.slow
def test_a_vehicle_that_departs_faster_than_its_type_can_is_an_error_of_the_input(tmp_path, refused):
    routes = VEHICLES.replace("<route ", '<vType id="t" maxSpeed="30"/><route ')
    path = own(tmp_path, routes=routes.replace("<flow ", '<flow type="t" departSpeed="90" '))
    line = refused("run", "--net", path, "--duration", "1", "--out", "run", "--quiet")
    assert "--net" in line
    assert "too high for the vehicle type 't'" in line
    assert not list(tmp_path.glob("*run*"))


def test_nothing_but_inputs_and_behaviour_is_taken_from_a_configuration(tmp_path):
    outputs = "".join(
        f'<{name} value="{tmp_path}/{name}.out"/>'
        for name in ("tripinfo-output", "fcd-output", "summary-output", "log", "save-state.files", "output-prefix")
    )
    others = (
        '<remote-port value="8813"/><num-clients value="2"/><end value="1:0:0:9"/><begin value="0:0:5"/>'
        '<step-length value="3"/><time-to-teleport value="120"/><load-state value="/etc/passwd"/>'
        '<seed value="77"/><python-script value="x.py"/>'
    )
    network = load_network(own(tmp_path, outputs + others))
    assert dict(network.sumo_inputs.options) == {"begin": "0:0:5", "time-to-teleport": "120"}
    assert {"tripinfo-output", "remote-port", "load-state", "python-script"} <= set(network.sumo_inputs.left_out)
    before = set(tmp_path.iterdir())
    truth = open_traffic(network, duration_s=1.0, seed=0, warm_up_s=1.0)
    assert len(list(truth.frames())) == 10
    truth.close()
    assert set(tmp_path.iterdir()) == before


@pytest.mark.parametrize("value", ["a;b", "../../x", "/tmp/file", "$(id)", "x" * 100, "1,2"])
def test_a_value_of_behaviour_is_a_plain_word(value, tmp_path):
    with pytest.raises(InputError, match="time-to-teleport"):
        load_network(own(tmp_path, f'<time-to-teleport value="{value}"/>'))


def test_a_pipe_in_the_place_of_a_file_is_refused_and_not_waited_for(tmp_path):
    for name in ("own.net.xml", "own.rou.xml", "own.sumocfg"):
        path = own(tmp_path)
        (tmp_path / name).unlink()
        os.mkfifo(tmp_path / name)
        with pytest.raises(InputError, match=name.replace(".", r"\.")):
            load_network(path)
        (tmp_path / name).unlink()


def hostile_demand(entry: str) -> str:
    return f"[demands.hostile]\ndescription='x'\ndensity_veh_per_km_lane=20.0\n{entry}\n[demands."


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("[demands.", hostile_demand("on_ramp_veh_per_h=1e12")),
        ("[demands.", hostile_demand("wave_period_s=nan")),
        ("[demands.", hostile_demand("headway_profile=[[0.0,-1.0]]")),
        ("[demands.", hostile_demand("schedule=[[5.0,1e9,1.0]]")),
        ("ego_lanes = [", "ego_lanes = [99, "),
        ("corridor_start_m = ", "corridor_start_m = -inf #"),
        ("section_m = [0.0, 640.0]", "section_m = [0.0, 1e-300]"),
    ],
)  # fmt: skip
def test_a_demand_that_no_road_carries_is_refused(old, new, tmp_path):
    assert old in METADATA
    shutil.copytree(US101, tmp_path, dirs_exist_ok=True)
    (tmp_path / "network.toml").write_text(METADATA.replace(old, new, 1))
    with pytest.raises(InputError, match=r"network\.toml"):
        load_network(str(tmp_path))
