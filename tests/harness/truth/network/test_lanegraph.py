"""A crossing that netconvert drew, as a graph of lanes: what follows what, what lies beside what, what is left out."""

import re
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.truth.network.lanegraph import read_lane_graph
from mmpf.map.control import FREE, SIGNAL, YIELD
from mmpf.map.lane_graph import NOWHERE

NETS = Path(__file__).parent / "nets"
CROSSING = NETS / "crossing.net.xml"


@pytest.fixture(scope="module")
def graph():
    return read_lane_graph(CROSSING).graph


def after(graph, lane):
    """Return the names of the lanes that follow one."""
    k = graph.name.index(lane)
    return [graph.name[to] for to in graph.successor[graph.first_successor[k] : graph.first_successor[k + 1]]]


def beside(graph, lane):
    """Return the names of the lanes to the left and to the right of one."""
    k = graph.name.index(lane)
    return tuple(None if other[k] == NOWHERE else graph.name[other[k]] for other in (graph.left, graph.right))


def changed(folder, change):
    """Return a copy of the network with its text changed."""
    path = folder / "changed.net.xml"
    path.write_text(change(CROSSING.read_text()))
    return path


def test_all_lanes_for_cars_are_there_and_the_footpath_is_not(graph):
    roads = {f"{arm}c_{k}" for arm, lanes in (("e", 2), ("w", 2), ("n", 1), ("s", 1)) for k in range(lanes)}
    assert roads <= set(graph.name)
    assert not any(name.startswith("path") for name in graph.name)
    assert all(graph.in_junction[k] == name.startswith(":") for k, name in enumerate(graph.name))


def test_each_lane_begins_where_those_before_it_end(graph):
    owner = np.repeat(np.arange(len(graph)), np.diff(graph.first_successor))
    ends, begins = graph.xy[graph.first_point[1:] - 1][owner], graph.xy[graph.first_point[:-1]][graph.successor]
    assert len(owner) > 20
    assert np.abs(ends - begins).max() < 0.01


def test_from_the_west_paths_across_the_junction_lead_to_the_other_three_arms(graph):
    paths = [path for lane in ("wc_0", "wc_1") for path in after(graph, lane)]
    assert {to[:2] for path in paths for to in ends(graph, path)} == {"ce", "cn", "cs"}


def ends(graph, path):
    """Return where a path across the junction comes out, through further ones."""
    return [to for k in after(graph, path) for to in (after(graph, k) if k.startswith(":") else [k])]


def test_the_lane_on_the_left_is_the_left_neighbour_whichever_side_of_the_road_is_driven_on(graph):
    assert beside(graph, "wc_0") == ("wc_1", None)
    assert beside(graph, "wc_1") == (None, "wc_0")
    left_hand = read_lane_graph(NETS / "crossing-left.net.xml").graph
    assert beside(left_hand, "wc_0") == (None, "wc_1")
    assert beside(left_hand, "wc_1") == ("wc_0", None)


def test_a_path_without_length_is_linked_past(graph, tmp_path):
    path = next(name for name in after(graph, "nc_0") if not after(graph, name)[0].startswith(":"))
    onward = after(graph, path)
    short = changed(
        tmp_path, lambda text: re.sub(rf'(id="{path}"[^>]*shape=")[^"]*"', r'\g<1>1.00,1.00 1.00,1.00"', text)
    )
    without = read_lane_graph(short).graph
    assert path not in without.name
    assert set(onward) <= set(after(without, "nc_0"))


def test_places_stay_small_numbers_however_far_away_the_network_lies(graph, tmp_path):
    def far(text):
        return re.sub(
            r"(-?[\d.]+),(-?[\d.]+)(?=[ \"])", lambda xy: f"{float(xy[1]) + 643200:.2f},{float(xy[2]) + 5e6:.2f}", text
        )

    moved = read_lane_graph(changed(tmp_path, far))
    assert moved.origin_xy == (643_000.0, 5_000_000.0)
    assert np.allclose(moved.graph.xy - graph.xy, [200.0, 0.0], atol=0.011)


def test_a_network_of_rails_alone_is_one_clear_line(tmp_path):
    rails = changed(
        tmp_path, lambda text: re.sub("<lane ", '<lane allow="rail" ', re.sub(r' (dis)?allow="[^"]*"', "", text))
    )
    with pytest.raises(InputError, match="no lane of it is for road vehicles"):
        read_lane_graph(rails)


def link(graph, lane, to):
    """Return the number of the link from one lane to another."""
    k = graph.name.index(lane)
    links = range(graph.first_successor[k], graph.first_successor[k + 1])
    return next(n for n in links if graph.name[graph.successor[n]] == to)


def foes(graph, number):
    """Return the paths that those wait for who take a link."""
    control = graph.control
    return {
        graph.name[graph.successor[k]] for k in control.foe[control.first_foe[number] : control.first_foe[number + 1]]
    }


def test_who_comes_from_the_side_road_waits_for_those_on_the_main_road(graph):
    straight = link(graph, "nc_0", ":c_1_0")
    assert graph.control.kind[straight] == YIELD
    assert {":c_11_0", ":c_11_1", ":c_4_0", ":c_4_1"} <= foes(graph, straight)
    on_the_main_road = link(graph, "wc_0", ":c_11_0")
    assert graph.control.kind[on_the_main_road] == FREE
    assert not foes(graph, on_the_main_road)


def test_who_turns_left_waits_for_oncoming_traffic_within_the_junction_and_not_before_it(graph):
    before, within = link(graph, "wc_1", ":c_13_0"), link(graph, ":c_13_0", ":c_15_0")
    assert (graph.control.kind[before], graph.control.kind[within]) == (FREE, YIELD)
    assert not foes(graph, before)
    assert {":c_4_0", ":c_4_1"} <= foes(graph, within)


def test_each_signal_holds_the_links_that_it_stands_at():
    junction = next((Path(__file__).parents[4] / "networks" / "junction").glob("*.net.xml"))
    graph = read_lane_graph(junction).graph
    control = graph.control
    straight = link(graph, "east_in_0", ":crossing_5_0")
    assert control.kind[straight] == SIGNAL
    assert control.signal_name[control.signal[straight]] == "crossing:5"
    assert len(control.signal_name) == 16
    assert (control.kind[graph.in_junction[graph.link_from]] != SIGNAL).all()
