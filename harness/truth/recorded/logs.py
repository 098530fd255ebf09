"""Reads truth, detections and tracks in other programs' formats into this project's tables.

Every reader returns rows with ``episode``, ``time_s`` on the file's own clock, ``id`` and a place (``lon_m``,
``lat_m``); all other columns of ``harness.storage.schema`` where the file has them. Places are in the plane unless a
road is told.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from harness.common.bounds import OF_THINGS, UNIT, Numbers, check_columns, check_numbers, row_number
from harness.common.errors import InputError
from harness.common.isolation import ProcessLimits, isolated
from harness.common.named import named
from harness.common.untrusted_files import check_file, checked_path, read_text
from harness.truth.recorded.detected.kitti import (
    BOX,
    CameraWay,
    boxes_in_plane,
    ego_path,
    of_vehicles,
    read_detections,
    read_poses,
)
from harness.truth.recorded.detected.numbers import numbers_of, words_of
from harness.truth.recorded.detected.recorded_drive import EGO
from mmpf.numerics.arrays import FloatArray, turned
from mmpf.registry import Entry, Registry

TRUTH, DETECTIONS, TRACKS = "truth", "detections", "tracks"
FORMATS = ("parquet", "csv", "kitti", "mot", "nuscenes", "mcap")
KITTI_VEHICLES, KITTI_NOTHING = ("Car", "Van", "Truck"), "DontCare"
NUSCENES_VEHICLES = ("car", "truck", "bus", "trailer")
KITTI_WORDS, PIXELS_PER_M = 17, 100.0
IDENTITY = {"the identity": Numbers(-1, 2**53, whole=True)}
IDENTITIES = {TRUTH: "vehicle_id", TRACKS: "track_id", DETECTIONS: "truth_id"}
OTHER_NAMES = {"x_m": "lon_m", "y_m": "lat_m", "timestamp_s": "time_s", "yaw_rad": "heading_rad"}
bags: Registry[Callable[[Path, str, str | None], pd.DataFrame]] = Registry(
    "format of logs", entries={"mcap": Entry("harness.truth.recorded.messages:read_bag", extra="mcap")}
)
topics: Registry[Callable[[Path, str], str]] = Registry(
    "format of logs", entries={"mcap": Entry("harness.truth.recorded.messages:topic_of", extra="mcap")}
)


@dataclass(frozen=True)
class LogFile:
    """A file or folder with a log.

    Attributes:
        role: ``TRUTH``, ``DETECTIONS`` or ``TRACKS``.
        format: One of ``FORMATS``; None recognises it.
        step_s: Time between frames that are only counted.
    """

    path: Path
    role: str
    format: str | None = None
    step_s: float = 0.1
    ego: Path | None = None

    def read(self) -> pd.DataFrame:
        """Read it in a process of its own.

        Raises:
            InputError: It is missing, of no known format, or broken.
        """
        path = checked_path(split_topic(self.path)[0], self.role)
        if not path.exists():
            raise InputError(f"`{self.role}`: {path} does not exist")
        name = self.format or _recognised(path, self.role)
        if name not in FORMATS:
            raise InputError(f"`format` {name}: there is none; choose from {', '.join(FORMATS)}")
        if name == "mcap":
            named(bags, "format", name)  # what is not installed is told of here
        files = sorted(path.glob("*.txt")) if path.is_dir() else [path]
        if not files:
            raise InputError(f"`{self.role}`: {path} has no .txt files; give a file, or a folder of KITTI's")
        try:
            rows = isolated(
                partial(_read, self, name, files), f"`{self.role}`: {path} ({name})", ProcessLimits.for_files(files)
            )
        except InputError as error:
            told = str(error)
            raise error if "`" in told else InputError(f"`{self.role}`: {told} (read as {name})") from None
        if not len(rows) and self.role == TRUTH:
            raise InputError(f"`{self.role}`: {path} holds no vehicle")
        return rows


def _recognised(path: Path, role: str) -> str:
    suffix = path.suffix.lower().lstrip(".")
    by_suffix = {"parquet": "parquet", "csv": "csv", "json": "nuscenes", "mcap": "mcap"}
    if path.is_dir() or suffix not in by_suffix:
        first = path if path.is_file() else next(iter(sorted(path.glob("*.txt"))), None)
        if first is None:
            raise InputError(f"`{role}`: {path} is of no known format; name it with `format`: {', '.join(FORMATS)}")
        check_file(first, role)
        with first.open("rb") as file:
            line = file.readline(4096)
        return "mot" if line.count(b",") in range(5, 12) else "kitti"
    return by_suffix[suffix]


def _read(log: LogFile, name: str, files: Sequence[Path]) -> pd.DataFrame:
    readers: dict[str, Callable[[LogFile, Path], pd.DataFrame]] = {
        "parquet": _table, "csv": _table, "kitti": _kitti, "mot": _mot, "nuscenes": _nuscenes,
        "mcap": lambda log, path: bags["mcap"](path, log.role, split_topic(log.path)[1]),
    }  # fmt: skip
    read = [readers[name](log, file) for file in files]
    # Of a table that tells no episodes its times do, which are the run's.
    timed = name in ("csv", "parquet") and log.role != TRUTH
    parts = [rows if "episode" in rows or timed else rows.assign(episode=k) for k, rows in enumerate(read)]
    rows = pd.concat(parts, ignore_index=True)
    check_numbers(log.path, rows, OF_THINGS)
    return rows


def _table(log: LogFile, path: Path) -> pd.DataFrame:
    """Read Parquet or CSV with the columns of this project's tables, or some of them."""
    check_file(path, log.role)
    texts = dict.fromkeys(("vehicle_id", "truth_id", "occluder_id", "state", "sample_token"), "string")
    if path.suffix == ".parquet":
        rows = pd.read_parquet(path)
    else:
        rows = pd.read_csv(path, dtype=texts, keep_default_na=False, na_values=[""], skipinitialspace=True)
    check_columns(path, rows.columns, rows.columns.intersection([*OF_THINGS, *OTHER_NAMES, *texts]))
    rows = rows.rename(columns={old: new for old, new in OTHER_NAMES.items() if old in rows and new not in rows})
    for name in rows.columns.intersection(list(texts)):
        rows[name] = rows[name].fillna("").astype(str)
    identity = IDENTITIES[log.role]
    needed = ["lon_m", "lat_m", *([] if log.role == DETECTIONS else [identity])]
    check_columns(path, rows.columns, needed)
    if "time_s" not in rows and "sample_token" not in rows:
        if "step" not in rows:
            raise InputError(f"{path} lacks the column time_s (or step)")
        rows["time_s"] = rows["step"] * log.step_s
    if identity in rows:
        rows["id"] = rows[identity]
    return rows


def read_poses_table(path: Path, step_s: float) -> pd.DataFrame:
    """Read a table of the sensor's poses: ``time_s``, ``lon_m``, ``lat_m``, ``heading_rad``, and more if known."""
    if split_topic(path)[0].suffix == ".mcap":
        return isolated(partial(named(bags, "format", "mcap"), path, EGO, None), f"`ego`: {path}").assign(episode=0)
    rows = isolated(partial(_table, LogFile(path, DETECTIONS, step_s=step_s), path), f"`ego`: {path}")
    check_columns(f"`ego`: {path}", rows.columns, ["heading_rad"])
    check_numbers(f"`ego`: {path}", rows, OF_THINGS)
    return rows if "episode" in rows else rows.assign(episode=0)


def _kitti(log: LogFile, path: Path) -> pd.DataFrame:
    """Read KITTI's labels or tracks, or boxes in AB3DMOT's layout; the plane is that of the first camera."""
    if log.role == DETECTIONS and b"," in path.open("rb").readline(4096):
        found = of_vehicles(read_detections(path))
        frame, box, more = found[:, 0], found[:, BOX], dict[str, npt.NDArray[Any]]()
    else:
        rows = words_of(path, None, KITTI_WORDS, "boxes")
        identity, kind = numbers_of(path, rows, 1, 2)[:, 0], np.array([row[2] for row in rows], dtype=np.str_)
        check_numbers(path, {"the identity": identity}, IDENTITY)
        kept = np.flatnonzero(kind != KITTI_NOTHING if log.role == TRUTH else np.isin(kind, KITTI_VEHICLES))
        values = numbers_of(path, [[rows[k][0], *rows[k][10:KITTI_WORDS]] for k in kept], 0, 8)
        frame, box = values[:, 0], values[:, 1:8]
        more = {} if log.role == DETECTIONS else {"id": identity[kept].astype(np.int64)}
        if log.role == TRUTH:
            more |= {"pedestrian": ~np.isin(kind[kept], KITTI_VEHICLES)}
    way = _camera_way(log, path, int(frame.max(initial=0.0)) + 1)
    boxes = boxes_in_plane(path, frame, box, way)
    read = pd.DataFrame(
        {
            "time_s": boxes.step * log.step_s, "lon_m": boxes.x_m, "lat_m": boxes.y_m, "heading_rad": boxes.heading_rad,
            "length_m": boxes.length_m, "width_m": boxes.width_m, **more,
        }
    )  # fmt: skip
    if log.role != TRUTH:
        return read
    ego = ego_path(way)
    poses = {"lon_m": ego.x_m, "lat_m": ego.y_m, "heading_rad": ego.heading_rad}
    camera = pd.DataFrame({"time_s": np.arange(len(ego)) * log.step_s, "id": EGO, "is_ego": True, **poses})
    return pd.concat([read.assign(is_ego=False), camera], ignore_index=True)


def _camera_way(log: LogFile, path: Path, frames: int) -> CameraWay:
    """Return the camera's poses; without any the plane moves with it."""
    if log.ego is None:
        return CameraWay(np.broadcast_to(np.eye(3), (frames, 3, 3)), np.zeros((frames, 3)))
    return read_poses(log.ego / path.name if log.ego.is_dir() else log.ego)


def _mot(log: LogFile, path: Path) -> pd.DataFrame:
    """Read MOTChallenge lines: with x, y, z in the plane in columns 8 to 10, or boxes from above, a pixel a cm."""
    rows = words_of(path, ",", 6, "boxes")
    width = min(map(len, rows), default=6)
    values = numbers_of(path, [row[:width] for row in rows], 0, width)
    check_numbers(path, {"the identity": values[:, 1]}, IDENTITY)
    known = {"time_s": (values[:, 0] - 1.0) * log.step_s, "id": values[:, 1].astype(np.int64)}
    if log.role == TRUTH:  # it is ignored where the confidence is zero
        known["pedestrian"] = (values[:, 6:7] == 0.0).any(axis=1)
    if width >= 10 and (values[:, 7:9] != -1.0).any():  # nine columns end with class and visibility
        return pd.DataFrame(known | {"lon_m": values[:, 7], "lat_m": values[:, 8]})
    left, top, length, across = (values[:, 2:6] / PIXELS_PER_M).T
    known |= {"lon_m": left + 0.5 * length, "lat_m": -(top + 0.5 * across), "length_m": length, "width_m": across}
    return pd.DataFrame(known)


def _nuscenes(log: LogFile, path: Path) -> pd.DataFrame:
    """Read nuScenes' JSON of tracking or detection results; what its samples' times are, poses or ``step_s`` tell."""
    results = json.loads(read_text(path, log.role))["results"]
    boxes = [
        box | {"sample_token": token, "order": place}
        for place, (token, found) in enumerate(results.items())
        for box in found
    ]
    kind = np.array([box.get("tracking_name", box.get("detection_name", "car")) for box in boxes], dtype=np.str_)
    is_vehicle = np.isin(kind, NUSCENES_VEHICLES)
    place = np.array([box["translation"][:2] for box in boxes], dtype=np.float64).reshape(-1, 2)
    turn = np.array([box["rotation"] for box in boxes], dtype=np.float64).reshape(-1, 4)
    heading = heading_of(turn)
    size = np.array([box["size"][:2] for box in boxes], dtype=np.float64).reshape(-1, 2)
    velocity = np.array([box.get("velocity", (np.nan, np.nan)) for box in boxes], dtype=np.float64).reshape(-1, 2)
    columns = {
        "sample_token": [box["sample_token"] for box in boxes], "order": [box["order"] for box in boxes],
        "lon_m": place[:, 0], "lat_m": place[:, 1], "heading_rad": heading, "length_m": size[:, 1],
        "width_m": size[:, 0], "pedestrian": ~is_vehicle,
    }  # fmt: skip
    if np.isfinite(velocity).all():
        columns["speed_mps"], columns["lat_speed_mps"] = turned(velocity[:, 0], velocity[:, 1], heading)
    if log.role != DETECTIONS:
        columns["id"] = [str(box["tracking_id"]) for box in boxes]
    rows = pd.DataFrame(columns)
    return rows if log.role == TRUTH else rows[is_vehicle].drop(columns="pedestrian").reset_index(drop=True)


def split_topic(path: Path) -> tuple[Path, str | None]:
    """Return the file and the topic of ``FILE.mcap:/topic``; None where no topic is named."""
    file, colon, topic = str(path).partition(".mcap:")
    return (Path(f"{file}.mcap"), topic) if colon else (path, None)


def heading_of(turn_wxyz: FloatArray) -> FloatArray:
    """Return the direction in the plane of turns as quaternions, rows of w, x, y, z, shape (n, 4).

    Raises:
        ValueError: One is no unit quaternion.
    """
    UNIT.check("the square of a rotation's length", (turn_wxyz**2).sum(axis=1), row_number)
    w, x, y, z = turn_wxyz.T
    return np.asarray(np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))
