"""Networks that travel with the project, and the user's own."""

import itertools

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
    inside = us101.road.to_cartesian(*(value[None] for value in _point(10.0, 5.0)))
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


def test_a_missing_configuration_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none\.sumocfg"):
        load_network(str(tmp_path / "none.sumocfg"))


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"network\.toml"):
        load_network(str(tmp_path))


@pytest.mark.parametrize(
    "net",
    ["", "<net>", "no xml", "<net></net>", "<net><edge id='a'><lane/></edge></net>", "<routes/>"],
)
def test_a_malformed_net_file_is_one_clear_line(tmp_path, net):
    (tmp_path / "bad.net.xml").write_text(net)
    (tmp_path / "bad.sumocfg").write_text(
        '<configuration><input><net-file value="bad.net.xml"/></input></configuration>'
    )
    with pytest.raises(InputError, match=r"bad\.net\.xml"):
        load_network(str(tmp_path))


@pytest.mark.parametrize(
    "content", ["", "<configuration/>", "<configuration", '<configuration><net-file value="x"/></configuration>']
)
def test_a_malformed_configuration_is_one_clear_line(tmp_path, content):
    (tmp_path / "bad.sumocfg").write_text(content)
    with pytest.raises(InputError):
        load_network(str(tmp_path / "bad.sumocfg"))


def test_broken_metadata_is_one_clear_line(tmp_path):
    for content in ("[", "description = 1", "unknown = true"):
        (tmp_path / "network.toml").write_text(content)
        with pytest.raises(InputError, match=r"network\.toml"):
            load_network(str(tmp_path))


def test_off_the_lanes_there_is_no_lane(us101):
    lon, lat = _point(100.0, -2.0)
    assert us101.road.lane_number_at(lon[None], lat[None])[0] == NO_LANE


def _point(lon, lat):
    import numpy as np  # noqa: PLC0415

    return np.float64(lon), np.float64(lat)
