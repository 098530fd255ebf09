"""Networks in the plane that come with the project, or lie in a folder of the user's own."""

import shutil

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.truth.network.names import shipped_networks
from harness.truth.network.network import available_networks, default_demand, load_network

NAMES = ("curve", "interchange", "junction", "priority", "roundabout")


@pytest.mark.parametrize("name", NAMES)
def test_a_network_in_the_plane_has_a_graph_demands_and_no_main_road(name):
    network = load_network(name)
    assert network.road.graph is not None
    assert network.corridor is None
    assert default_demand(name) == network.default_demand == "middle"
    light, middle, heavy = (network.demand(entry).density_veh_per_km_lane for entry in network.demands)
    assert light < middle < heavy
    with pytest.raises(InputError, match="density"):
        network.demand_for_density(3.0)


def test_nets_lists_them_by_the_length_of_their_lanes():
    listed = {each.name: each for each in available_networks()}
    assert set(listed) == {*NAMES, "us101"}
    # Four arms of 220 m less the crossing, two lanes each way.
    assert listed["junction"].section_length_m == pytest.approx(16 * (220.0 - 15.0), rel=0.02)
    assert listed["junction"].lanes == 0
    assert listed["us101"].lanes == 5


@pytest.mark.parametrize(
    ("entry", "wrong", "told"),
    [
        ('default_demand = "middle"', 'default_demand = "none"', "default_demand none"),
        ('routes_file = "priority.rou.xml"', 'routes_file = "gone.rou.xml"', "gone.rou.xml"),
        ('kind = "plane"', 'kind = "sphere"', "kind"),
        ("density_veh_per_km_lane = 20.0", "density_veh_per_km_lane = 400.0", "density_veh_per_km_lane"),
    ],
)
def test_a_wrong_entry_is_told_in_one_line(tmp_path, entry, wrong, told):
    folder = shutil.copytree(shipped_networks()["priority"], tmp_path / "own")
    file = folder / "network.toml"
    assert entry in file.read_text()
    file.write_text(file.read_text().replace(entry, wrong))
    with pytest.raises(InputError, match=told):
        load_network(str(folder))


def test_the_fingerprint_changes_with_the_buildings(tmp_path):
    folder = shutil.copytree(shipped_networks()["priority"], tmp_path / "own")
    before = load_network(str(folder)).fingerprint()
    buildings = folder / "priority.poly.xml"
    buildings.write_text(buildings.read_text().replace("8.00,9.00", "8.50,9.00"))
    assert load_network(str(folder)).fingerprint() != before


def test_the_ring_of_the_roundabout_and_its_junctions_are_known_and_its_arms_are_none_of_it():
    plane = load_network("roundabout").plane
    x, y = np.array([plane.graph.line(lane).mean(axis=0) for lane in range(len(plane.graph))]).T
    centre = np.array([x[plane.in_roundabout].mean(), y[plane.in_roundabout].mean()])
    away = np.hypot(x - centre[0], y - centre[1])
    # The ring has a radius of 26 m to its middle.
    assert plane.in_roundabout[away < 31.0].all()
    assert not plane.in_roundabout[away > 45.0].any()
