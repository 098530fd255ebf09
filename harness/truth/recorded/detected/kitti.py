"""KITTI tracking: labels that continue through occlusion, a detector's boxes, and the camera's poses.

A folder has for each sequence ``label_02/NNNN.txt`` (KITTI's labels), ``detection/NNNN.txt`` (boxes in the layout of
AB3DMOT's repository) and ``poses/NNNN.txt`` (camera to first camera, twelve numbers a frame). All are in the frame of
the left camera, so that no calibration is needed. The plane is that of the first frame: x ahead, y to the left.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harness.common.bounds import PLACE_M, Numbers, check_moves, check_numbers
from harness.common.errors import InputError
from harness.truth.recorded.detected.numbers import BOX as OF_BOX
from harness.truth.recorded.detected.numbers import MOMENTS, numbers_of, words_of
from harness.truth.recorded.detected.recorded_drive import (
    Drive,
    EgoPoses,
    GivenBoxes,
    Labels,
    RecordedBoxes,
    sorted_by_step,
)
from mmpf.numerics.arrays import FloatArray, StringArray
from mmpf.scan import BUS, CAR, MOTORCYCLE, TRAILER, TRUCK, UNKNOWN_CLASS

LABELS, DETECTIONS, POSES = "label_02", "detection", "poses"
VEHICLES = {"Car": CAR, "Van": CAR, "Truck": TRUCK}
DETECTED = {2: CAR, 4: MOTORCYCLE, 5: BUS, 6: TRAILER, 7: TRUCK}
"""Classes of vehicles by the numbers of AB3DMOT."""
# A place in the picture where nobody labelled anything, not a thing.
NO_THING = "DontCare"
LABEL_WORDS, DETECTION_WORDS, POSE_WORDS = 17, 15, 12
# Columns of detections.
KIND, SCORE, ANGLE = 1, 6, 14
PICTURE, BOX = slice(2, 6), slice(7, 14)
POSE = {"a pose": PLACE_M, "the distance from a rotation": Numbers(0.0, 0.01)}
THING = {"the number of a thing": Numbers(0, 10_000_000, whole=True)}


class SequenceFiles(NamedTuple):
    """The files of a sequence."""

    labels: Path
    detections: Path
    poses: Path


@dataclass(frozen=True)
class CameraWay:
    """Poses of the camera: points of its frame (x right, y down, z ahead) to those of the first, by step."""

    rotation: FloatArray
    shift: FloatArray


def sequences(path: Path) -> tuple[SequenceFiles, ...]:
    """Return the files of each sequence of a folder, or of the one whose label file is given.

    Raises:
        InputError: There are none.
    """
    root, labels = path.parent.parent, [path]
    if path.is_dir():
        root = path.parent if path.name == LABELS else path
        labels = sorted((root / LABELS).glob("*.txt"))
    if not labels:
        raise InputError(f"`replay`: {path} has no {LABELS}/NNNN.txt; docs/how-to/recording.md shows the folder")
    return tuple(SequenceFiles(file, root / DETECTIONS / file.name, root / POSES / file.name) for file in labels)


def files_of(path: Path) -> tuple[Path, ...]:
    """Return the files of all sequences."""
    return tuple(file for files in sequences(path) for file in files)


def read_kitti(path: Path) -> tuple[Drive, ...]:
    """Read the sequences of a folder, or of one label file.

    Raises:
        InputError: A file is missing or broken, or they contradict each other; the message names it.
    """
    return tuple(read_sequence(files) for files in sequences(path))


def read_sequence(files: SequenceFiles) -> Drive:
    """Read one sequence; see ``read_kitti``."""
    way = read_poses(files.poses)
    names, labels = _labels(files.labels, way)
    found = read_detections(files.detections)
    kept = of_vehicles(found)
    boxes = boxes_in_plane(files.detections, kept[:, 0], kept[:, BOX], way)
    classes = np.array([DETECTED[kind] for kind in kept[:, KIND].tolist()], dtype=np.int64)
    given = GivenBoxes(**boxes.columns, score=kept[:, SCORE], vehicle_class=classes)
    others = len(np.unique(labels.thing)) - len(np.unique(labels.thing[labels.counts]))
    return Drive(
        name=files.labels.stem,
        ego=ego_path(way),
        names=names,
        labels=labels,
        given=sorted_by_step(given),
        left_out={
            "labelled things that are no car, van or truck": others,
            "detections of something else than vehicles": len(found) - len(kept),
        },
    )


def read_detections(path: Path) -> FloatArray:
    """Return a file's rows of frame, kind, 2-D box (4), score, 3-D box (7) and angle of observation, shape (d, 15).

    Raises:
        InputError: The file is missing or broken.
    """
    return numbers_of(path, words_of(path, ",", DETECTION_WORDS, "detections"), 0, DETECTION_WORDS)


def of_vehicles(found: FloatArray) -> FloatArray:
    """Return the rows of detections that are of vehicles, sorted by frame, those of one frame in their order."""
    kept = found[np.isin(found[:, KIND], list(DETECTED))]
    return np.asarray(kept[np.argsort(kept[:, 0], kind="stable")])


def _labels(path: Path, way: CameraWay) -> tuple[StringArray, Labels]:
    """Return the names and the labels of a label file; an ``InputError`` where it labels nothing."""
    words = [row for row in words_of(path, None, LABEL_WORDS, "labels") if row[2] != NO_THING]
    if not words:
        raise InputError(f"{path} labels nothing")
    values = numbers_of(path, [[*row[:2], *row[3:LABEL_WORDS]] for row in words], 0, LABEL_WORDS - 1)
    check_numbers(path, {"the number of a thing": values[:, 1]}, THING)
    numbers, thing = np.unique(values[:, 1].astype(np.int64), return_inverse=True)
    names = numbers.astype(np.str_)
    boxes = boxes_in_plane(path, values[:, 0], values[:, 9:16], way)
    classes = np.array([VEHICLES.get(row[2], UNKNOWN_CLASS) for row in words], dtype=np.int64)
    labels = Labels(
        **boxes.columns,
        thing=thing.astype(np.int64),
        counts=classes != UNKNOWN_CLASS,
        # Partly covered, or cut off by the picture.
        covered=(values[:, 2] > 0.0) | (values[:, 3] > 0.0),
        vehicle_class=classes,
    )
    labels = sorted_by_step(labels)
    check_moves(path, names[labels.thing], labels.step / 10.0, labels.x_m, labels.y_m, labels.heading_rad)
    return names, labels


def read_poses(path: Path) -> CameraWay:
    """Read poses: three rows of a rotation and a shift a line.

    Raises:
        InputError: The file is missing or broken, has too many poses or none, or one that turns nothing rigidly.
    """
    rows = words_of(path, None, POSE_WORDS, "camera poses")
    check_numbers(path, {"the count of poses": len(rows)}, {"the count of poses": MOMENTS}, "")
    pose = numbers_of(path, rows, 0, POSE_WORDS).reshape(-1, 3, 4)
    rotation, shift = pose[:, :, :3], pose[:, :, 3]
    off = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    off = np.where(np.linalg.det(rotation) > 0.0, off, 2.0)  # a mirror is no turn
    check_numbers(path, {"a pose": shift, "the distance from a rotation": off}, POSE, lambda row: f"pose {row}")
    way = CameraWay(rotation, shift)
    ego, count = ego_path(way), len(pose)
    check_moves(path, np.full(count, "the camera"), np.arange(count) / 10.0, ego.x_m, ego.y_m, ego.heading_rad, True)
    return way


def boxes_in_plane(path: Path, frame: FloatArray, box: FloatArray, way: CameraWay) -> RecordedBoxes:
    """Return boxes that are in the camera's frame as they lie in the plane.

    Args:
        box: Rows of height, width, length, x, y, z of the bottom's middle and turn about y, shape (n, 7).

    Raises:
        InputError: A box is impossible, or of a frame without a pose.
    """
    told = {"the frame": frame, "the size": box[:, :3], "the place": box[:, 3:6], "the turn": box[:, 6]}
    check_numbers(path, told, OF_BOX)
    step = frame.astype(np.int64)
    if len(step) and step.max() >= len(way.shift):
        raise InputError(f"{path} has frame {step.max()}, but there are poses of {len(way.shift)} frames")
    rotation = way.rotation[step]
    turn = box[:, 6]
    front = np.stack([np.cos(turn), np.zeros(len(turn)), -np.sin(turn)], axis=-1)
    x, y = _on_ground((rotation @ box[:, 3:6, None])[:, :, 0] + way.shift[step])
    return RecordedBoxes(step, x, y, _heading((rotation @ front[:, :, None])[:, :, 0]), box[:, 2], box[:, 1])


def ego_path(way: CameraWay) -> EgoPoses:
    """Return the camera's way in the plane."""
    return EgoPoses(*_on_ground(way.shift), _heading(way.rotation[:, :, 2]))


def _on_ground(point: FloatArray) -> tuple[FloatArray, FloatArray]:
    return point[:, 2], -point[:, 0]


def _heading(direction: FloatArray) -> FloatArray:
    x, y = _on_ground(direction)
    return np.asarray(np.arctan2(y, x))
