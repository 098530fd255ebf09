"""Networks that travel with the project, and the user's own."""

import itertools

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.truth.network.network import available_networks, load_network
from mmpf.map.road import NO_LANE


@pytest.fixture(scope="module")
def us101():
    return load_network("us101")


def test_us101_has_the_lanes_of_the_site(us101):
    lanes = {lane.number: lane for lane in us101.road.lanes}
    assert sorted(lanes) == [1, 2, 3, 4, 5, 6]
    assert lanes[5].right_m == pytest.approx(0.0)
    assert lanes[1].left_m == pytest.approx(5 * 3.66)
    assert (lanes[6].start_m, lanes[6].end_m) == pytest.approx((188.0, 411.0))
    assert (lanes[6].right_m, lanes[6].left_m) == pytest.approx((-3.66, 0.0))


def test_edges_of_the_main_road_abut_so_that_nothing_jumps_between_them(us101):
    edges = us101.corridor.edges
    for before, after in itertools.pairwise(edges):
        assert before.end_m == pytest.approx(after.start_m, abs=1e-3)


def test_road_frame_is_the_plane_turned_and_shifted(us101):
    assert us101.road.is_straight
    inside = us101.road.to_cartesian(np.array([10.0]), np.array([5.0]))
    assert us101.road.to_road(*inside) == (pytest.approx(10.0), pytest.approx(5.0))


def test_ramps_meet_the_auxiliary_lane(us101):
    names = [edge.name for edge in us101.corridor.edges]
    assert {names[ramp.index] for ramp in (*us101.on_ramps, *us101.off_ramps)} == {"auxiliary"}


def test_every_network_is_listed_with_its_demands():
    listed = {network.name: network for network in available_networks()}
    assert listed["us101"].lanes == 5
    demands = dict(listed["us101"].demands)
    assert {"us101-0750", "us101-0805", "us101-0820"} <= set(demands)
    assert all(demands.values())


def test_an_unknown_demand_is_answered_with_the_known_ones(us101):
    with pytest.raises(InputError, match=r"rush.*us101-0805"):
        us101.demand("rush")


def test_an_unknown_network_is_answered_with_the_known_ones():
    with pytest.raises(InputError, match=r"`net` atlantis.*us101"):
        load_network("atlantis")


BY_NET = '<configuration><input><net-file value="bad.net.xml"/></input></configuration>'


@pytest.mark.parametrize(
    ("files", "asked", "named"),
    [
        ({}, "none.sumocfg", r"none\.sumocfg"),
        ({}, "", r"network\.toml"),
        *(
            ({"bad.sumocfg": BY_NET, "bad.net.xml": net}, "", r"bad\.net\.xml")
            for net in ("", "<net>", "no xml", "<net></net>", "<net><edge id='a'><lane/></edge></net>", "<routes/>")
        ),
        *(
            ({"bad.sumocfg": content}, "bad.sumocfg", r"bad\.sumocfg|network file: x")
            for content in (
                "",
                *(f"<configuration{rest}" for rest in ("/>", "", '><net-file value="x"/></configuration>')),
            )
        ),
        *(({"network.toml": content}, "", r"network\.toml") for content in ("[", "description = 1", "unknown = true")),
    ],
)
def test_what_is_missing_or_malformed_of_a_network_is_named(files, asked, named, tmp_path):
    for name, content in files.items():
        (tmp_path / name).write_text(content)
    with pytest.raises(InputError, match=named):
        load_network(str(tmp_path / asked))


def test_off_the_lanes_there_is_no_lane(us101):
    assert us101.road.lane_number_at(np.array([100.0]), np.array([-2.0]))[0] == NO_LANE
