"""The networks in the plane are what their scripts build: bends as tight as told, routes that lead through."""

import importlib.util
import sys
from itertools import pairwise
from pathlib import Path
from xml.etree.ElementTree import parse

import numpy as np
import pytest

from harness.truth.network.limits import check_xml

NETWORKS = Path(__file__).parents[2] / "networks"
NAMES = ("curve", "interchange", "junction", "priority", "roundabout")
WITH_BUILDINGS = ("junction", "priority")


def edges_of(name):
    """Return the lanes' middle lines of each edge, paths across junctions included."""
    root = parse(NETWORKS / name / f"{name}.net.xml").getroot()
    return {
        edge.get("id"): [
            np.array([[float(value) for value in point.split(",")] for point in lane.get("shape").split()])
            for lane in edge.iter("lane")
        ]
        for edge in root.iter("edge")
    }


def dense(line):
    """Return points of a line, a metre apart or less."""
    steps = np.hypot(*np.diff(line, axis=0).T)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    wanted = np.linspace(0.0, along[-1], max(2, int(along[-1]) + 1))
    return np.column_stack([np.interp(wanted, along, line[:, axis]) for axis in (0, 1)])


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_files_are_what_their_script_builds(name, tmp_path, monkeypatch):
    pytest.importorskip("sumo", reason="netconvert comes with the networks extra")
    monkeypatch.syspath_prepend(str(NETWORKS))
    specification = importlib.util.spec_from_file_location(f"build_{name}", NETWORKS / name / "build.py")
    builder = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(builder)
    builder.build(builder.draw(), tmp_path, name)
    sys.modules.pop("plain", None)
    built = sorted(path.name for path in tmp_path.iterdir())
    assert built == sorted(path.name for path in (NETWORKS / name).glob(f"{name}.*.xml"))
    for file in built:
        assert (tmp_path / file).read_bytes() == (NETWORKS / name / file).read_bytes(), file


@pytest.mark.parametrize("name", NAMES)
def test_every_route_leads_from_edge_to_edge_and_every_file_is_within_the_limits(name):
    folder = NETWORKS / name
    net = parse(folder / f"{name}.net.xml").getroot()
    follows = {(link.get("from"), link.get("to")) for link in net.iter("connection")}
    routes = [route.get("edges").split() for route in parse(folder / f"{name}.rou.xml").getroot().iter("route")]
    assert len(routes) >= 2
    assert all(pair in follows for route in routes for pair in pairwise(route))
    for file in folder.glob("*.xml"):
        assert not check_xml(file)


@pytest.mark.parametrize("name", NAMES)
def test_bodies_are_spread_as_those_of_the_recorded_road(name):
    types = list(parse(NETWORKS / name / f"{name}.rou.xml").getroot().iter("vType"))
    share = np.array([float(entry.get("probability")) for entry in types])
    length, width = (np.array([float(entry.get(key)) for entry in types]) for key in ("length", "width"))
    assert share.sum() == pytest.approx(1.0, abs=1e-4)
    # NGSIM US-101: 4.64 +- 1.41 m and 1.91 +- 0.28 m.
    mean = float(share @ length)
    assert mean == pytest.approx(4.64, abs=0.3)
    assert float(np.sqrt(share @ (length - mean) ** 2)) == pytest.approx(1.41, abs=0.5)
    assert float(share @ width) == pytest.approx(1.91, abs=0.1)


def test_the_bends_of_curve_have_their_radii():
    there = [lanes[1] for name, lanes in sorted(edges_of("curve").items()) if name.startswith("there_")]
    found = set()
    for line in there:
        turn = np.diff(np.unwrap(np.arctan2(*np.diff(line, axis=0).T[::-1])))
        if abs(turn.sum()) > 0.1:
            step = np.hypot(*np.diff(line, axis=0).T)
            found.add(round(abs(float(np.median(0.5 * (step[1:] + step[:-1])[1:-1] / turn[1:-1]))), -1))
    # The carriageway lies 7.25 m to the right of the road's middle, whose bends are of 100, 150, 200 and 400 m.
    assert found == {90.0, 110.0, 140.0, 190.0, 410.0}


@pytest.mark.parametrize("name", WITH_BUILDINGS)
def test_no_building_stands_on_a_lane_and_those_at_the_corners_hide_who_comes(name):
    from shapely import LineString, Polygon  # noqa: PLC0415

    polygons = parse(NETWORKS / name / f"{name}.poly.xml").getroot().iter("poly")
    buildings = [
        Polygon([[float(value) for value in point.split(",")] for point in entry.get("shape").split()])
        for entry in polygons
        if entry.get("type") == "building"
    ]
    lanes = [dense(line) for lines in edges_of(name).values() for line in lines if len(line) > 1]
    assert len(buildings) == 12
    nearest = min(building.distance(LineString(lane)) for building in buildings for lane in lanes)
    assert 1.75 + 1.0 < nearest < 12.0
    sight = LineString([(40.0, -2.0), (2.0, 40.0)])
    assert any(building.intersects(sight) for building in buildings)


@pytest.mark.parametrize("name", ["roundabout"])
def test_the_ring_is_driven_counter_clockwise(name):
    for edge, lanes in edges_of(name).items():
        if edge.endswith(("_ring", "_next")):
            for line in lanes:
                angle = np.unwrap(np.arctan2(line[:, 1], line[:, 0]))
                assert angle[-1] > angle[0]
                assert np.hypot(*line.T) == pytest.approx(np.hypot(*line[0]), abs=0.2)
