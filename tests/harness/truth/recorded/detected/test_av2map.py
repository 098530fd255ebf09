"""The lanes of an Argoverse 2 log are the road: a lane with another beside it, and two ways across a junction."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.running.open import open_snapshots
from harness.running.resolve import resolve_run_config
from harness.truth.recorded.detected.av2 import read_av2
from harness.truth.recorded.detected.source import DriveTruth
from mmpf.map.lane_graph import NOWHERE, LaneGraph
from mmpf.map.road import NO_LANE
from tests.harness.truth.recorded.detected.test_av2 import CITY, STEPS, YAW_RAD, write_av2

AHEAD = np.array([np.cos(YAW_RAD), np.sin(YAW_RAD)])
LEFT = np.array([-AHEAD[1], AHEAD[0]])
WIDTH_M = 3.5
WITH_MAP = ("traffic.recording.map=true",)
# Middle lines as the recording car sees them at its first place, and what else the map says of each.
SEGMENTS: dict[int, tuple[list[tuple[float, float]], dict[str, Any]]] = {
    1: ([(-20, 0), (30, 0)], {"successors": [2, 3, 99], "left_neighbor_id": 4, "right_neighbor_id": 6}),
    2: ([(30, 0), (50, 0)], {"successors": [5], "is_intersection": True}),
    3: ([(30, 0), (38, -2), (40, -10)], {"is_intersection": True, "lane_type": "BUS"}),
    4: ([(30, 3.5), (-20, 3.5)], {"left_neighbor_id": 1}),
    5: ([(50, 0), (90, 0)], {}),
    6: ([(-20, -3.5), (30, -3.5)], {"left_neighbor_id": 1}),
    7: ([(-20, -7), (30, -7)], {"lane_type": "BIKE", "left_neighbor_id": 6}),
}


def segment(number: int, middle: list[tuple[float, float]], other: dict[str, Any]) -> dict[str, Any]:
    line = np.array(middle)
    along = np.gradient(line, axis=0)
    across = 0.5 * WIDTH_M * np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]

    def boundary(points: np.ndarray[Any, Any]) -> list[dict[str, float]]:
        city = CITY + points[:, :1] * AHEAD + points[:, 1:] * LEFT
        return [{"x": float(x), "y": float(y), "z": 7.0} for x, y in city]

    plain: dict[str, Any] = {"lane_type": "VEHICLE", "is_intersection": False, "successors": [], "predecessors": []}
    neighbours = {"left_neighbor_id": None, "right_neighbor_id": None}
    bounds = {"left_lane_boundary": boundary(line + across), "right_lane_boundary": boundary(line - across)}
    return {"id": number, **plain, **neighbours, **bounds, **other}


def made_map() -> dict[str, Any]:
    return {"lane_segments": {str(k): segment(k, *of) for k, of in SEGMENTS.items()}, "pedestrian_crossings": {}}


def write_map(log: Path, content: str) -> Path:
    path = log / "map" / "log_map_archive_log____XYZ_city_1.json"
    path.parent.mkdir()
    path.write_text(content, encoding="utf-8")
    return path


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_map(write_av2(tmp_path) / "log", json.dumps(made_map()))
    return tmp_path


@pytest.fixture
def graph(folder: Path) -> LaneGraph:
    (drive,) = read_av2(folder, with_map=True)
    return drive.lanes


def test_vehicles_lanes_are_the_road_and_bicycles_lanes_are_not(graph: LaneGraph) -> None:
    assert graph.name == ("1", "2", "3", "4", "5", "6")
    assert graph.width_m[[0, 3, 5]] == pytest.approx(WIDTH_M)
    assert graph.line(0)[0] == pytest.approx(-20.0 * AHEAD, abs=1e-3)


def test_both_ways_across_the_junction_follow_and_are_in_it(graph: LaneGraph) -> None:
    assert graph.successor[graph.first_successor[0] : graph.first_successor[1]].tolist() == [1, 2]
    assert graph.in_junction.tolist() == [False, True, True, False, False, False]


def test_an_oncoming_lane_is_no_neighbour(graph: LaneGraph) -> None:
    assert (graph.left[0], graph.right[0]) == (NOWHERE, 5)
    assert (graph.left[3], graph.left[5]) == (NOWHERE, 0)


def test_the_ego_drives_on_its_lane_and_who_walks_is_on_none(folder: Path) -> None:
    truth = DriveTruth(folder, "av2", read_av2(folder, with_map=True))
    graph = truth.road.graph
    for frame in truth.frames():
        lanes = dict(zip(frame.vehicle_id.tolist(), frame.lane.tolist(), strict=True))
        assert graph.name[lanes["ego"] - 1] == "1"
        assert lanes["walker"] == NO_LANE
    assert "maps with 6 lanes" in truth.report()
    assert truth.summary()["lanes"] == 6


def test_logs_with_maps_lie_beside_each_other(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        write_av2(tmp_path / name)
        (tmp_path / name / "log").rename(tmp_path / f"log {name}")
        (tmp_path / name).rmdir()
        write_map(tmp_path / f"log {name}", json.dumps(made_map()))
    a, b, c = read_av2(tmp_path, with_map=True)
    truth = DriveTruth(tmp_path, "av2", (a, replace(b, lanes=None), c))
    graph = truth.road.graph
    assert graph.name[::6] == ("log a/1", "log c/1")
    egos = {frame.episode: frame for frame in truth.frames() if frame.step % STEPS == 0}
    assert [float(frame.lon_m[0]) for frame in egos.values()] == [0.0, 2000.0, 4000.0]
    assert [int(frame.lane[0]) for frame in egos.values()] == [1, NO_LANE, 7]
    near = graph.lanes_near(np.array([4000.0]), np.array([0.0]), most=1)
    assert (near.lane[0], near.left_m[0]) == (6, pytest.approx(0.0, abs=1e-3))
    assert graph.successor.tolist() == [1, 2, 4, 7, 8, 10]


def test_unless_the_map_is_asked_for_nothing_is_known_of_lanes(folder: Path) -> None:
    truth = DriveTruth(folder, "av2", read_av2(folder))
    assert not truth.road.graph.has_map
    assert all((frame.lane == NO_LANE).all() for frame in truth.frames())


def test_the_setting_takes_the_map_as_the_road_of_a_run(folder: Path) -> None:
    snapshots = open_snapshots(resolve_run_config(None, {"replay": str(folder), "format": "av2"}, WITH_MAP))
    assert snapshots.road.graph.name == ("1", "2", "3", "4", "5", "6")
    assert any("map" in name for name in snapshots.files)


def test_a_map_that_is_not_there_is_named(tmp_path: Path) -> None:
    asked = {"replay": str(write_av2(tmp_path)), "format": "av2"}
    with pytest.raises(InputError, match=r"`traffic.recording.map`: .*/log has no map"):
        open_snapshots(resolve_run_config(None, asked, WITH_MAP))
    with pytest.raises(InputError, match=r"`traffic.recording.map`: only av2 has a map"):
        open_snapshots(resolve_run_config(None, asked | {"format": "kitti-tracking"}, WITH_MAP))


def broken(**changes: Any) -> str:
    content = made_map()
    content["lane_segments"]["1"] |= changes
    return json.dumps(content)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("{", "no map"),
        ("[]", "no map"),
        ("\0", "no map"),
        ("[" * 100_000, "no map"),
        ("{}", "'lane_segments' is missing"),
        ('{"lane_segments": {}}', "no lane of it is for vehicles"),
        ('{"lane_segments": {"1": {"lane_type": "VEHICLE"}}}', "is missing"),
        (broken(left_lane_boundary=[{"x": 1.0, "y": 1.0}]), "two points"),
        (broken(left_lane_boundary=[{"x": 1.0, "y": 1.0}, {"x": 1e9, "y": 1.0}]), ", not from "),
        (broken(left_lane_boundary=[{"x": 1.0, "y": 1.0}, {"x": float("nan"), "y": 1.0}]), "not finite"),
        (broken(left_lane_boundary=[{"x": 0.0, "y": 0.0}, {"x": 9e4, "y": 0.0}]), "the length of a boundary"),
        (broken(right_lane_boundary={"x": 1.0}), "no map"),
        (broken(right_lane_boundary=None), "no map"),
        (broken(successors=3), "no map"),
        (broken(is_intersection="no"), "neither true nor false"),
        (broken(id=2), "there twice"),
    ],
)
def test_broken_maps_are_named_in_one_line(tmp_path: Path, content: str, says: str) -> None:
    path = write_map(write_av2(tmp_path) / "log", content)
    with pytest.raises(InputError, match=says) as error:
        read_av2(tmp_path, with_map=True)
    assert str(path) in str(error.value)
