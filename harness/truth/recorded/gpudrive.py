"""Waymo Open Motion scenes as GPUDrive writes them: a JSON of objects' states every tenth of a second, and roads."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import InputError
from harness.common.untrusted_files import unpacked
from harness.truth.frame import STEP_S
from harness.truth.recorded.planetracks import MiddleLine, Way, traffic_of_ways
from harness.truth.recorded.rows import ReadTraffic
from mmpf.numerics.arrays import FloatArray


def read_gpudrive(path: Path) -> ReadTraffic:
    """Read a scene's vehicles and lanes.

    Raises:
        InputError: It is no such file, or lacks what is needed.
    """
    try:
        with unpacked(path) as file:
            scene = json.load(file)
        vehicles = {k: thing for k, thing in enumerate(scene["objects"]) if thing["type"] == "vehicle"}
        ways = [_way(str(k), vehicle) for k, vehicle in vehicles.items()]
        lines = {str(k): MiddleLine(_xy(lane["geometry"])) for k, lane in enumerate(scene["roads"]) if _is_lane(lane)}
        others = len(scene["objects"]) - len(vehicles)
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError) as error:
        what = f"{type(error).__name__} {str(error)[:100]}"
        raise InputError(f"{path}: no scene of GPUDrive: {what}; give one as it wrote it") from None
    return traffic_of_ways(ways, lines, path, {"no vehicle": others})


def _is_lane(road: Mapping[str, Any]) -> bool:
    return bool(road["type"] == "lane")


def _way(name: str, vehicle: Mapping[str, Any]) -> Way:
    valid = np.array([state is True for state in vehicle["valid"]])
    place, velocity = _xy(vehicle["position"])[valid], _xy(vehicle["velocity"])[valid]
    heading = np.array(vehicle["heading"], dtype=np.float64)[valid]
    return Way(
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
