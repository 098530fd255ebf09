"""V2V4Real as DMSTrack's repository has it: one car's own detections, and labels of what either of two cars saw.

A folder has for each sequence ``label_02/NNNN.txt`` and ``detection/NNNN.txt``. There are no poses: all boxes are in
the moving frame of the recording car, x ahead, z to the left, turned by the last number. So the plane moves with it:
speeds are those against the recording car, and nobody can be told to be parked.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.truth.recorded.detected.drive import Boxes, Drive, EgoPath, GivenBoxes, Labels, sorted_by_step
from harness.truth.recorded.detected.kitti import (
    BOX,
    DETECTIONS,
    SCORE,
    cars,
    label_files,
    read_detections,
    read_labels,
)
from harness.truth.recorded.detected.numbers import check_boxes
from mmpf.numerics.arrays import FloatArray, wrapped

KINDS = ("Car",)


def files_of(path: Path) -> tuple[Path, ...]:
    """Return the files of all sequences of a folder, or of the one whose label file is given."""
    return tuple(file for pair in _sequences(path) for file in pair)


def read_v2v4real(path: Path) -> tuple[Drive, ...]:
    """Read a folder's sequences, or the one whose label file is given.

    Raises:
        InputError: A file is missing or broken; the message names it.
    """
    return tuple(_read(labels, detections) for labels, detections in _sequences(path))


def _sequences(path: Path) -> list[tuple[Path, Path]]:
    root, labels = label_files(path)
    return [(file, root / DETECTIONS / file.name) for file in labels]


def _read(label_file: Path, detection_file: Path) -> Drive:
    rows = read_labels(label_file)
    boxes = _boxes(label_file, rows.frame, rows.box)
    found = cars(read_detections(detection_file))
    given = _boxes(detection_file, found[:, 0], found[:, BOX])
    steps = 1 + int(max(boxes.step.max(), given.step.max(initial=0)))
    still = np.zeros(steps)
    counts = np.isin(rows.kind, KINDS)
    labels = Labels(**boxes.columns, thing=rows.thing, counts=counts, covered=np.zeros(len(boxes), dtype=np.bool_))
    return Drive(
        name=label_file.stem,
        ego=EgoPath(still, still, still),
        names=rows.names,
        labels=sorted_by_step(labels),
        given=sorted_by_step(GivenBoxes(**given.columns, score=found[:, SCORE])),
        moves_with_ego=True,
    )


def _boxes(path: Path, frame: FloatArray, box: FloatArray) -> Boxes:
    check_boxes(path, frame, box[:, :3], box[:, 3:6])
    return Boxes(frame.astype(np.int64), box[:, 3], box[:, 5], wrapped(box[:, 6]), box[:, 2], box[:, 1])
