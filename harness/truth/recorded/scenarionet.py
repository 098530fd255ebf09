"""ScenarioNet's scenes (Li et al. 2023): a pickle of trajectories and lanes from nuScenes, Waymo and others.

A pickle may call whatever it names; here it may only make numbers, texts, plain containers and NumPy's arrays.
"""

import pickle
from collections import OrderedDict, defaultdict
from collections.abc import Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from harness.common.errors import InputError
from harness.truth.network.polyline import length_of
from harness.truth.recorded.planetracks import USUAL_LANE_M, MiddleLine, PlaneTrajectory, Scene, traffic_of_scene
from harness.truth.recorded.rows import ReadTraffic
from mmpf.numerics.arrays import FloatArray
from mmpf.scan import BUS, CAR, MOTORCYCLE, TRAILER, TRUCK, UNKNOWN_CLASS

PLAIN = {("collections", "defaultdict"): defaultdict, ("collections", "OrderedDict"): OrderedDict} | {
    ("builtins", kind.__name__): kind for kind in (int, float, bool, str, list, tuple, dict, set)
}
OF_NUMPY = {"_reconstruct": np.array(0).__reduce__()[0], "scalar": np.float64(0).__reduce__()[0]}
OF_NUMPY |= {"ndarray": np.ndarray, "dtype": np.dtype}
LANE_WIDTHS_M = (2.5, 6.0)
CLASSES = {"vehicle.car": CAR, "vehicle.motorcycle": MOTORCYCLE, "vehicle.trailer": TRAILER}
CLASSES |= {"vehicle.truck": TRUCK, "vehicle.construction": TRUCK}
CLASSES |= {"vehicle.bus.rigid": BUS, "vehicle.bus.bendy": BUS}
"""Classes by nuScenes' names, which its scenes keep; other data sets' scenes tell none."""


class _Plain(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> object:
        if module.split(".", maxsplit=1)[0] == "numpy" and name in OF_NUMPY:
            return OF_NUMPY[name]
        if (module, name) in PLAIN:
            return PLAIN[module, name]
        raise InputError(f"it asks for {module}.{name}"[:80])


def read_scenarionet(path: Path) -> ReadTraffic:
    """Read a scene's vehicles and lanes."""
    return traffic_of_scene(path, _scene, "scene of ScenarioNet")


def _scene(file: BinaryIO) -> Scene:
    scene = _Plain(file).load()
    sdc = scene["metadata"].get("sdc_id")
    vehicles = {name: track for name, track in scene["tracks"].items() if track["type"] == "VEHICLE"}
    clock = np.asarray(scene["metadata"]["ts"], dtype=np.float64)[: int(scene["length"])]
    ways = [_way("ego" if name == sdc else str(name), track, clock) for name, track in vehicles.items()]
    lines = {str(name): _line(lane) for name, lane in scene["map_features"].items() if _is_lane(lane)}
    return ways, lines, len(scene["tracks"]) - len(vehicles)


def _way(name: str, track: Mapping[str, Any], clock: FloatArray) -> PlaneTrajectory:
    state = track["state"]
    valid = np.asarray(state["valid"]).astype(np.bool_)
    if valid.shape != clock.shape:
        raise InputError(f"vehicle {name[:20]} has {valid.shape} times, the scene {clock.shape}")
    place, velocity = (np.asarray(state[key], dtype=np.float64)[valid][:, :2] for key in ("position", "velocity"))
    heading = np.asarray(state["heading"], dtype=np.float64).reshape(-1)[valid]
    size = [np.asarray(state[key], dtype=np.float64).reshape(-1)[valid] for key in ("length", "width")]
    return PlaneTrajectory(
        name=name,
        time_s=clock[valid],
        x_m=place[:, 0],
        y_m=place[:, 1],
        heading_rad=heading,
        speed_mps=velocity[:, 0] * np.cos(heading) + velocity[:, 1] * np.sin(heading),
        # Of nuScenes' recording car the two are exchanged.
        length_m=np.maximum(*size),
        width_m=np.minimum(*size),
        vehicle_class=CLASSES.get(str(track.get("metadata", {}).get("type")), UNKNOWN_CLASS),
    )


def _is_lane(feature: Mapping[str, Any]) -> bool:
    return str(feature["type"]).startswith("LANE_") and "BIKE" not in str(feature["type"])


def _line(lane: Mapping[str, Any]) -> MiddleLine:
    xy = np.asarray([point[:2] for point in lane["polyline"]], dtype=np.float64)
    if len(xy) < 2 or "polygon" not in lane:
        return MiddleLine(xy.reshape(-1, 2))
    x, y = np.asarray([point[:2] for point in lane["polygon"]], dtype=np.float64).T
    area = 0.5 * abs(float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))))
    width = area / max(length_of(xy), 1e-3)
    # Where lines of a lane part or join its area says little of its width.
    return MiddleLine(xy, width if LANE_WIDTHS_M[0] <= width <= LANE_WIDTHS_M[1] else USUAL_LANE_M)
