"""Argoverse 2 maps: the drivable lane segments of a log as lanelets."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import InputError
from harness.common.untrusted_files import check_file, reading
from harness.truth.network.polyline import checked_line
from harness.truth.recorded.lanelets import Lanelet
from mmpf.numerics.arrays import FloatArray

ARCHIVES = "map/log_map_archive_*.json"
FOR_VEHICLES = ("VEHICLE", "BUS")


def map_files(log: Path) -> list[Path]:
    """Return what may be the map of a log's folder."""
    return sorted(log.glob(ARCHIVES))


def map_file(log: Path) -> Path:
    """Return the map of a log's folder.

    Raises:
        InputError: There is none, or there are several.
    """
    found = map_files(log)
    if not found:
        raise InputError(f"`traffic.recording.map`: {log} has no {ARCHIVES}; leave the setting out or add the map")
    if len(found) > 1:
        raise InputError(f"{log} has {len(found)} files {ARCHIVES}; leave the one that is the log's")
    return found[0]


def read_lanelets(path: Path, origin_xy: FloatArray) -> tuple[Lanelet, ...]:
    """Read the lanes for vehicles of a map.

    Args:
        path: The map.
        origin_xy: The city's coordinates of the plane's origin, metres, shape (2,).

    Raises:
        InputError: The file is broken, or has no lane for vehicles; the message names it.
    """
    check_file(path)
    with reading(path, "map of Argoverse 2"):
        segments = json.loads(path.read_text(encoding="utf-8"))["lane_segments"]
        chosen = [segment for segment in segments.values() if segment["lane_type"] in FOR_VEHICLES]
        lanelets = {str(segment["id"]): _lanelet(segment, origin_xy) for segment in chosen}
    if not lanelets:
        raise InputError(f"{path}: no lane of it is for vehicles; leave `traffic.recording.map` out")
    if len(lanelets) < len(chosen):
        raise InputError(f"{path}: a lane segment's id is there twice")
    return tuple(_with_neighbours(lanelet, lanelets) for lanelet in lanelets.values())


def _lanelet(segment: Mapping[str, Any], origin_xy: FloatArray) -> Lanelet:
    if not isinstance(segment["is_intersection"], bool):
        raise TypeError("is_intersection is neither true nor false")
    return Lanelet(
        name=str(segment["id"]),
        left_xy=_points(segment["left_lane_boundary"]) - origin_xy,
        right_xy=_points(segment["right_lane_boundary"]) - origin_xy,
        successors=tuple(str(other) for other in segment["successors"]),
        left=_neighbour(segment["left_neighbor_id"]),
        right=_neighbour(segment["right_neighbor_id"]),
        in_junction=segment["is_intersection"],
    )


def _points(boundary: Sequence[Mapping[str, float]]) -> FloatArray:
    points = np.array([(point["x"], point["y"]) for point in boundary], dtype=np.float64)
    return checked_line(points, 1e4, "a boundary")


def _neighbour(name: int | None) -> str | None:
    return None if name is None else str(name)


def _with_neighbours(lanelet: Lanelet, others: Mapping[str, Lanelet]) -> Lanelet:
    """Return a lanelet whose neighbours lead its way: the map names oncoming lanes too."""
    left, right = (
        name if name is not None and name in others and _way(others[name]) @ _way(lanelet) > 0.0 else None
        for name in (lanelet.left, lanelet.right)
    )
    return replace(lanelet, left=left, right=right)


def _way(lanelet: Lanelet) -> FloatArray:
    line = lanelet.centre_xy()
    return np.asarray(line[-1] - line[0])
