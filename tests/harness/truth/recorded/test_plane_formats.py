"""Formats whose vehicles drive in the plane: PandaSet, ScenarioNet, GPUDrive."""

import json
import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from harness.common.errors import InputError
from harness.running.resolve import resolve_run_config
from harness.running.run import run
from harness.truth.recorded.formats import example, read_traffic, recognise
from harness.truth.recorded.planetracks import MiddleLine, lanelets_of
from harness.truth.recorded.source import open_recorded_traffic
from mmpf.scan import CAR, TRUCK

STEPS = 51
HEADER = "timestamp,uuid,label,yaw,position.x,position.y,dimensions.x,dimensions.y"


def write_pandaset(path: Path, turn: float = -0.5 * np.pi) -> Path:
    """Write a recording car that stands, a car that drives along x at 10 m/s, and a pedestrian."""
    rows = [HEADER]
    for k in range(STEPS):
        rows.append(f"{0.1 * k:.1f},ego,Ego,{turn},0,0,1.9,5.2")
        rows.append(f"{0.1 * k:.1f},a,Car,{turn},{10 + k},3.5,1.8,4.5")
        rows.append(f"{0.1 * k:.1f},p,Pedestrian,0,5,9,0.5,0.5")
    path.write_text("\n".join(rows) + "\n")
    return path


def test_pandasets_vehicles_drive_where_their_cuboids_are(tmp_path):
    path = write_pandaset(tmp_path / "scene.dat")
    assert recognise(path).name == "pandaset"
    truth = open_recorded_traffic(path, "pandaset", "recording", "ego", 60.0)
    frames = list(truth.frames())
    assert len(frames) == STEPS
    for k, frame in enumerate(frames):
        row = frame.vehicle_id.tolist().index("a")
        assert frame.lon_m[row] - frame.lon_m[frame.ego] == pytest.approx(10.0 + k)
        assert frame.lat_m[row] - frame.lat_m[frame.ego] == pytest.approx(3.5)
        assert frame.heading_rad[row] == pytest.approx(0.0, abs=1e-9)
        assert frame.speed_mps[row] == pytest.approx(10.0)
        assert (frame.length_m[row], frame.width_m[row], frame.vehicle_class[row]) == (4.5, 1.8, CAR)
    assert truth.summary()["vehicles_left_out"] == {"no vehicle": 1}


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda text: text.replace("position.y", "y"), "it has no column position.y"),
        (lambda text: text.replace("\n", ",yaw\n", 1), "the column yaw is there twice"),
        (lambda text: text.replace(",3.5,", ",far,", 1), "no table of PandaSet's cuboids"),
        (lambda text: text.replace(",3.5,", ",inf,", 1), "not finite"),
        (lambda text: text.replace(",3.5,", ",1e12,", 1), ", not from "),
        (lambda text: text.replace(",Car,", ",Cones,").replace(",Ego,", ",Cones,"), "no vehicle"),
        (lambda text: text.replace(",a,", ",,"), "no name"),
    ],
)
def test_what_is_wrong_with_a_table_of_cuboids_is_one_line(spoil, said, tmp_path):
    path = write_pandaset(tmp_path / "scene.csv")
    path.write_text(spoil(path.read_text()))
    with pytest.raises(InputError, match=said):
        read_traffic(path, "pandaset", "recording")


def test_the_sequence_that_comes_with_the_harness_runs_by_its_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = resolve_run_config(options={"replay": "pandaset", "tracker": "oracle-kalman", "duration": 2.0})
    assert config.traffic.recording.ego == "ego"
    metrics = run(config, out=tmp_path / "run").metrics
    assert metrics["recording"]["vehicles_kept"] > 50
    assert metrics["recording"]["seconds"] == 2.0


def test_the_sequence_that_comes_with_the_harness_names_its_licence():
    notice = example(Path("pandaset")).with_name("NOTICE").read_text()
    assert "CC BY 4.0" in notice


def lanes() -> dict[str, list[tuple[float, float]]]:
    """Return two lanes along x that lie beside each other, and one that follows the right one."""
    right = [(5000.0 + x, 2000.0) for x in range(0, 41, 5)]
    left = [(x, y + 3.5) for x, y in right]
    after = [(5040.0 + x, 2000.0) for x in range(0, 41, 5)]
    return {"right": right, "left": left, "after": after}


def scene_of_scenarionet() -> dict[str, Any]:
    """Return a scene: a recording car that stands, a car on the right lane at 10 m/s, a pedestrian."""

    def track(kind: str, x: list[float], speed: float) -> dict[str, Any]:
        state = {
            "position": np.column_stack([np.add(x, 5000.0), np.full(STEPS, 2000.0), np.zeros(STEPS)]),
            "heading": np.zeros(STEPS),
            "velocity": np.tile([speed, 0.0], (STEPS, 1)),
            "valid": np.ones(STEPS),
            "length": np.full((STEPS, 1), 1.8),
            "width": np.full((STEPS, 1), 4.5),
        }
        return {"type": kind, "state": state, "metadata": {"type": "vehicle.truck"}}

    tracks = {
        "sdc": track("VEHICLE", [0.0] * STEPS, 0.0),
        "7": track("VEHICLE", [10.0 + k for k in range(STEPS)], 10.0),
        "p": track("PEDESTRIAN", [3.0] * STEPS, 0.0),
    }
    features: dict[str, Any] = {name: {"type": "LANE_SURFACE_STREET", "polyline": xy} for name, xy in lanes().items()}
    features["line"] = {"type": "ROAD_LINE_SOLID_SINGLE_WHITE", "polyline": np.zeros((4, 2))}
    for xy, lane in ((xy, features[name]) for name, xy in lanes().items()):
        lane["polygon"] = [(x, y - 1.75) for x, y in xy] + [(x, y + 1.75) for x, y in xy[::-1]]
    metadata = {"ts": np.arange(STEPS) * 0.1, "sdc_id": "sdc"}
    return {"length": STEPS, "metadata": metadata, "tracks": tracks, "map_features": features}


def scene_of_gpudrive() -> dict[str, Any]:
    """Return the same scene; the standing car is out of sight, at no place, for the first second."""

    def thing(kind: str, x: list[float], speed: float, unseen: int = 0) -> dict[str, Any]:
        return {
            "type": kind,
            "position": [
                {"x": 5000.0 + at, "y": 2000.0, "z": 0.0} if k >= unseen else {"x": -1e4, "y": -1e4, "z": 0.0}
                for k, at in enumerate(x)
            ],
            "velocity": [{"x": speed, "y": 0.0}] * STEPS,
            "heading": [0.0 if k >= unseen else -1e4 for k in range(STEPS)],
            "valid": [k >= unseen for k in range(STEPS)],
            "length": 4.5,
            "width": 1.8,
        }

    return {
        "name": "scene",
        "objects": [
            thing("pedestrian", [3.0] * STEPS, 0.0),
            thing("vehicle", [10.0 + k for k in range(STEPS)], 10.0),
            thing("vehicle", [0.0] * STEPS, 0.0, unseen=10),
        ],
        "roads": [
            *({"type": "lane", "geometry": [{"x": x, "y": y, "z": 0.0} for x, y in xy]} for xy in lanes().values()),
            {"type": "road_edge", "geometry": [{"x": 0.0, "y": 0.0, "z": 0.0}]},
        ],
    }


def write_scenarionet(path: Path, scene: object) -> Path:
    path.write_bytes(pickle.dumps(scene))
    return path


def write_gpudrive(path: Path, scene: object) -> Path:
    path.write_text(json.dumps(scene))
    return path


@pytest.mark.parametrize(
    ("format_name", "moving", "write", "scene"),
    [
        ("scenarionet", "7", write_scenarionet, scene_of_scenarionet),
        ("gpudrive", "1", write_gpudrive, scene_of_gpudrive),
    ],
)
def test_a_scenes_vehicles_drive_on_its_lanes(format_name, moving, write, scene, tmp_path):
    path = write(tmp_path / "scene.dat", scene())
    assert recognise(path).name == format_name
    truth = open_recorded_traffic(path, format_name, "recording", moving, 60.0)
    for k, frame in enumerate(truth.frames()):
        assert (frame.lon_m[frame.ego], frame.lat_m[frame.ego]) == (pytest.approx(10.0 + k), pytest.approx(0.0))
        assert frame.speed_mps[frame.ego] == pytest.approx(10.0)
        assert (frame.length_m[frame.ego], frame.width_m[frame.ego]) == (4.5, 1.8)
        told = None if frame.vehicle_class is None else frame.vehicle_class[frame.ego]
        assert told == (TRUCK if format_name == "scenarionet" else None)
        # At 30 it is where the one lane ends and the other begins.
        assert k == 30 or frame.lane[frame.ego] == (1 if k < 30 else 3)
    graph = truth.road.graph
    assert len(graph) == 3
    assert (graph.link_from.tolist(), graph.successor.tolist()) == ([0], [2])
    assert (graph.left[0], graph.right[1]) == (1, 0)
    np.testing.assert_allclose(graph.width_m, 3.5)


def test_a_vehicle_is_not_where_its_state_is_invalid(tmp_path):
    path = write_gpudrive(tmp_path / "scene.json", scene_of_gpudrive())
    frames = list(open_recorded_traffic(path, "gpudrive", "recording", "1", 60.0).frames())
    assert ["2" in frame.vehicle_id for frame in frames] == [k >= 10 for k in range(STEPS)]


@pytest.mark.parametrize("unit", [1.0, 180.0 / np.pi])
def test_headings_of_gpudrive_are_radians_or_degrees(unit, tmp_path):
    scene = scene_of_gpudrive()
    for k, turn in ((1, 0.0), (2, 0.5 * np.pi)):
        scene["objects"][k]["heading"][10:] = [turn * unit] * (STEPS - 10)
    path = write_gpudrive(tmp_path / "scene.json", scene)
    frame = list(open_recorded_traffic(path, "gpudrive", "recording", "1", 60.0).frames())[-1]
    np.testing.assert_allclose(frame.heading_rad, [0.0, 0.5 * np.pi])


class Opens:
    """What a pickle makes that wants to write a file when it is loaded."""

    def __init__(self, path: Path) -> None:
        """Take the file."""
        self.path = path

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        """Say what to call."""
        return os.mkdir, (str(self.path),)


def changed(scene: dict[str, Any], *keys: str, to: object) -> dict[str, Any]:
    """Return a scene with the value beneath some keys replaced."""
    inner = scene
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = to
    return scene


SCENES = {
    "scenarionet": (scene_of_scenarionet, write_scenarionet, "scene.pkl"),
    "gpudrive": (scene_of_gpudrive, write_gpudrive, "scene.json"),
}


@pytest.mark.parametrize(
    ("form", "keys", "to", "said"),
    [
        ("scenarionet", ("tracks",), {}, "no vehicle"),
        ("scenarionet", ("tracks",), 5, "no scene of ScenarioNet"),
        ("scenarionet", ("metadata", "ts"), np.zeros(3), "times"),
        ("scenarionet", ("tracks", "7", "state", "heading"), np.full(STEPS, np.nan), "not finite"),
        ("scenarionet", ("tracks", "7", "state", "position"), np.full((STEPS, 3), 1e9), ", not from "),
        ("scenarionet", ("map_features", "left", "polyline"), [(0.0, 0.0), (np.inf, 0.0)], "lane left"),
        ("gpudrive", ("objects",), [], "no vehicle"),
        ("gpudrive", ("roads",), {"a": 1}, "no scene of GPUDrive"),
        ("gpudrive", ("objects",), [{"type": "vehicle", "valid": [True] * STEPS}], "'heading'"),
        ("gpudrive", ("roads",), [{"type": "lane", "geometry": [{"x": 0, "y": 0}, {"x": 1e9, "y": 0}]}], "lane 0"),
    ],
)
def test_what_is_wrong_with_a_scene_is_told(form, keys, to, said, tmp_path):
    made, write, name = SCENES[form]
    path = write(tmp_path / name, changed(made(), *keys, to=to))
    with pytest.raises(InputError, match=said):
        read_traffic(path, form, "recording")


def test_a_pickle_calls_nothing_it_names(tmp_path):
    made = tmp_path / "made"
    path = write_scenarionet(tmp_path / "scene.pkl", scene_of_scenarionet() | {"more": Opens(made)})
    with pytest.raises(InputError, match=r"asks for posix\.mkdir"):
        read_traffic(path, "scenarionet", "recording")
    assert not made.exists()


def test_a_lane_that_turns_back_does_not_follow():
    to_the_east = MiddleLine(np.array([[0.0, 0.0], [20.0, 0.0]]))
    back = MiddleLine(np.array([[20.0, 0.5], [0.0, 0.5]]))
    on = MiddleLine(np.array([[20.5, 0.0], [40.0, 2.0]]))
    first = lanelets_of({"a": to_the_east, "b": back, "c": on}, Path("scene"))[0]
    assert first.successors == ("c",)
