"""Waymo Open Motion scenes in GPUDrive's JSON: states of objects every tenth of a second, and roads.

Headings are degrees in older files, radians in newer ones, and none says which: beyond a turn they are degrees. They
may count several turns.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from harness.truth.frame import STEP_S
from harness.truth.recorded.planetracks import MiddleLine, PlaneTrajectory, Scene, traffic_of_scene
from harness.truth.recorded.rows import ReadTraffic
from mmpf.numerics.arrays import BoolArray, FloatArray, wrapped

MOST_RAD = 6.5


def read_gpudrive(path: Path) -> ReadTraffic:
    """Read a scene's vehicles and lanes."""
    return traffic_of_scene(path, _scene, "scene of GPUDrive")


def _scene(file: BinaryIO) -> Scene:
    scene = json.load(file)
    vehicles = {k: thing for k, thing in enumerate(scene["objects"]) if thing["type"] == "vehicle"}
    unit = _heading_unit_rad(vehicles.values())
    ways = [_way(str(k), vehicle, unit) for k, vehicle in vehicles.items()]
    lanes = {str(k): road for k, road in enumerate(scene["roads"]) if road["type"] == "lane"}
    lines = {name: MiddleLine(_xy(lane["geometry"])) for name, lane in lanes.items()}
    return ways, lines, len(scene["objects"]) - len(vehicles)


def _heading_unit_rad(vehicles: Iterable[Mapping[str, Any]]) -> float:
    # Where a vehicle is out of sight its heading may be -10000.
    seen = [np.array(vehicle["heading"], dtype=np.float64)[_valid(vehicle)] for vehicle in vehicles]
    return float(np.deg2rad(1.0)) if any(np.abs(each).max(initial=0.0) > MOST_RAD for each in seen) else 1.0


def _valid(vehicle: Mapping[str, Any]) -> BoolArray:
    return np.array([state is True for state in vehicle["valid"]])


def _way(name: str, vehicle: Mapping[str, Any], unit_rad: float) -> PlaneTrajectory:
    valid = _valid(vehicle)
    place, velocity = _xy(vehicle["position"])[valid], _xy(vehicle["velocity"])[valid]
    heading = wrapped(np.array(vehicle["heading"], dtype=np.float64)[valid] * unit_rad)
    return PlaneTrajectory(
        name=name,
        time_s=np.flatnonzero(valid).astype(np.float64) * STEP_S,
        x_m=place[:, 0],
        y_m=place[:, 1],
        heading_rad=heading,
        speed_mps=velocity[:, 0] * np.cos(heading) + velocity[:, 1] * np.sin(heading),
        length_m=np.full(len(place), float(vehicle["length"])),
        width_m=np.full(len(place), float(vehicle["width"])),
    )


def _xy(points: list[Mapping[str, float]]) -> FloatArray:
    return np.array([(point["x"], point["y"]) for point in points], dtype=np.float64).reshape(-1, 2)
