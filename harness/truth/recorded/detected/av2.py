"""Argoverse 2 sensor logs: cuboids that continue without laser points, poses and lanes; no detector.

A folder holds folders of logs, each with ``annotations.feather`` (or ``annotations_with_ego.feather``) and
``city_SE3_egovehicle.feather``, and with ``map/log_map_archive_*.json`` where the lanes are to be known. Detections are
drawn: a vehicle is seen where at least three points of the real lidar fell into its cuboid, and the profile says how
far a box is off. The plane is that of the city, from the car's first place on.
"""

from dataclasses import fields
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow.dataset
import pyarrow.feather

from harness.common.bounds import PLACE_M, UNIT, Numbers, check_columns, check_moves, check_numbers
from harness.common.errors import InputError
from harness.common.untrusted_files import check_file, reading
from harness.truth.recorded.detected.av2map import map_file, map_files, read_lanelets
from harness.truth.recorded.detected.numbers import BOX, MOMENTS
from harness.truth.recorded.detected.recorded_drive import Drive, EgoPoses, GivenBoxes, Labels, sorted_by_step
from harness.truth.recorded.laneletgraph import graph_of_lanelets
from mmpf.numerics.arrays import FloatArray
from mmpf.scan import BUS, CAR, MOTORCYCLE, TRAILER, TRUCK, UNKNOWN_CLASS

ANNOTATIONS, POSES = "annotations.feather", "city_SE3_egovehicle.feather"
WITH_EGO = "annotations_with_ego.feather"
"""What the data set for scenario mining calls them; the recording car is among its boxes."""
FEWEST_POINTS = 3
VEHICLES = {"REGULAR_VEHICLE": CAR, "MOTORCYCLE": MOTORCYCLE, "VEHICULAR_TRAILER": TRAILER}
VEHICLES |= dict.fromkeys(("LARGE_VEHICLE", "BOX_TRUCK", "TRUCK", "TRUCK_CAB"), TRUCK)
VEHICLES |= dict.fromkeys(("BUS", "SCHOOL_BUS", "ARTICULATED_BUS"), BUS)
RECORDING_CAR = "EGO_VEHICLE"
TURN, PLACE = ["qw", "qx", "qy", "qz"], ["tx_m", "ty_m", "tz_m"]
WHEN, SIZE = "timestamp_ns", ["length_m", "width_m"]
OF_BOX = ["track_uuid", "category", *SIZE, *TURN, *PLACE, "num_interior_pts"]
STEP_NS = 100_000_000
ROWS = Numbers(1, 5_000_000)
"""Of a table; they are counted before anything is unpacked. A log of the data set has some 10 000 boxes."""
CLOCK = {"the count of moments": MOMENTS, "the usual step, ns,": Numbers(0, 1.5 * STEP_NS)}
CLOCK |= {"the longest step, ns,": Numbers(0, 2 * STEP_NS)}


def files_of(path: Path) -> tuple[Path, ...]:
    """Return the files of all logs of a folder, or of the log that it is."""
    return tuple(file for log in _logs(path) for file in (_annotations(log), log / POSES, *map_files(log)))


def read_av2(path: Path, with_map: bool = False) -> tuple[Drive, ...]:
    """Read a folder of logs, or one log's folder or annotations.

    Raises:
        InputError: A file is missing or broken, or they contradict each other; the message names it.
    """
    return tuple(_read(log, with_map) for log in _logs(path))


def argoverse_logs(path: Path) -> list[Path]:
    """Return the folders of the logs that a folder is or holds; none of anything else."""
    if not path.is_dir():
        return []
    logs = [path] if _annotations(path).exists() else sorted(path.glob("*"))
    return [log for log in logs if _annotations(log).exists()]


def _annotations(log: Path) -> Path:
    usual, with_ego = log / ANNOTATIONS, log / WITH_EGO
    return with_ego if with_ego.exists() and not usual.exists() else usual


def _logs(path: Path) -> list[Path]:
    logs = argoverse_logs(path) if path.is_dir() else [path.parent]
    if not logs:
        raise InputError(f"`replay`: {path} has no LOG/{ANNOTATIONS}; docs/how-to/recording.md shows the folder")
    return logs


def _read(log: Path, with_map: bool) -> Drive:
    annotations = _annotations(log)
    boxes = _table(annotations, [WHEN, *OF_BOX])
    boxes = boxes[boxes["category"] != RECORDING_CAR]
    poses = _table(log / POSES, [WHEN, *TURN, *PLACE]).drop_duplicates(WHEN).set_index(WHEN)
    clock = np.unique(boxes[WHEN].to_numpy(dtype=np.int64))
    steps = np.diff(clock)
    told = {"the count of moments": len(clock), "the usual step, ns,": np.median(steps) if len(steps) else STEP_NS}
    check_numbers(annotations, told | {"the longest step, ns,": steps.max(initial=0)}, CLOCK, "")
    if not np.isin(clock, poses.index.to_numpy()).all():
        raise InputError(f"{log / POSES} lacks the pose of a moment that {annotations.name} has")
    then = poses.loc[clock]
    rotation, shift = _rotations(log / POSES, then), then[PLACE].to_numpy(dtype=np.float64)
    check_numbers(log / POSES, {"a pose": shift}, {"a pose": PLACE_M})
    origin = shift[0]
    shift = shift - origin
    ego = EgoPoses(shift[:, 0], shift[:, 1], np.arctan2(rotation[:, 1, 0], rotation[:, 0, 0]))
    seconds = (clock - clock[0]) / 1e9
    check_moves(log / POSES, np.full(len(ego), "the car"), seconds, ego.x_m, ego.y_m, ego.heading_rad, True)
    step = np.searchsorted(clock, boxes[WHEN].to_numpy(dtype=np.int64)).astype(np.int64)
    place, size = boxes[PLACE].to_numpy(dtype=np.float64), boxes[SIZE].to_numpy(dtype=np.float64)
    check_numbers(annotations, {"the frame": step, "the size": size, "the place": place}, BOX)
    front = (rotation[step] @ _rotations(annotations, boxes)[:, :, :1])[:, :, 0]
    where = (rotation[step] @ place[:, :, None])[:, :, 0] + shift[step]
    names, thing = np.unique(boxes["track_uuid"].to_numpy(dtype=np.str_), return_inverse=True)
    counts = boxes["category"].isin(VEHICLES).to_numpy()
    points = boxes["num_interior_pts"].to_numpy(dtype=np.float64)
    labels = Labels(
        step=step,
        x_m=where[:, 0],
        y_m=where[:, 1],
        heading_rad=np.arctan2(front[:, 1], front[:, 0]),
        length_m=size[:, 0],
        width_m=size[:, 1],
        thing=thing.astype(np.int64),
        counts=counts,
        covered=points < FEWEST_POINTS,
        vehicle_class=np.array(
            [VEHICLES.get(kind, UNKNOWN_CLASS) for kind in boxes["category"].tolist()], dtype=np.int64
        ),
    )
    check_moves(annotations, names[thing], seconds[step], labels.x_m, labels.y_m, labels.heading_rad)
    seen = counts & (points >= FEWEST_POINTS)
    names_of = [column.name for column in fields(GivenBoxes) if column.name != "score"]
    columns = {name: getattr(labels, name)[seen] for name in names_of}
    others = len(names) - len(np.unique(labels.thing[counts]))
    return Drive(
        name=log.name,
        ego=ego,
        names=names,
        labels=sorted_by_step(labels),
        given=sorted_by_step(GivenBoxes(**columns, score=points[seen])),
        left_out={"labelled objects other than vehicles": others},
        drawn=True,
        lanes=graph_of_lanelets(read_lanelets(map_file(log), origin[:2]), map_file(log)) if with_map else None,
    )


def _table(path: Path, columns: list[str]) -> pd.DataFrame:
    check_file(path)
    with reading(path, "feather file"):
        rows = pyarrow.dataset.dataset(path, format="feather").count_rows()
    check_numbers(path, {"the count of rows": rows}, {"the count of rows": ROWS}, "")
    with reading(path, "feather file"):
        table: pd.DataFrame = pyarrow.feather.read_table(path, memory_map=False).to_pandas()
    check_columns(path, table.columns, columns)
    numbers = dict.fromkeys((name for name in columns if name not in ("track_uuid", "category")), Numbers())
    check_numbers(path, table, numbers | {WHEN: Numbers(whole=True)})
    return table[columns]


def _rotations(path: Path, table: pd.DataFrame) -> FloatArray:
    """Return rotations of unit quaternions, shape (n, 3, 3)."""
    w, x, y, z = table[TURN].to_numpy(dtype=np.float64).T
    check_numbers(
        path,
        {"the square of a rotation's length": w * w + x * x + y * y + z * z},
        {"the square of a rotation's length": UNIT},
    )
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.asarray(np.array(rows).transpose(2, 0, 1))
