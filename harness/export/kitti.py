"""A run over KITTI tracking in KITTI's layout, one file a sequence, as AB3DMOT's evaluation script reads it.

A track is a place; a benchmark wants a box in the camera's frame with a score. A track's box is that of the detection
at it, or of the last that was, put where the track is; its score is that detection's. Which detection is at which track
is decided here, from the tables alone and alike for every tracker: the nearest within two metres, one to one.
"""

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from harness.common.errors import InputError
from harness.running.finished import RecordedRun
from harness.storage.tables import floats
from harness.truth.frame import STEP_S
from harness.truth.recorded.detected import kitti
from harness.truth.recorded.detected.kitti import CameraWay
from harness.truth.recorded.detected.origin import GATE_M, pairs_within
from harness.truth.recorded.detected.recorded_drive import RecordedBoxes, step_starts
from harness.truth.recorded.formats import least_score_of
from mmpf.numerics.arrays import FloatArray, IntArray, wrapped

NAME = "kitti-tracking"
SCRIPT, SCRIPT_NAME = "trackeval_kitti_script.py", "score.py"
COASTED_S = 0.2
"""A track is written for this long after the last detection at it: the benchmark wants boxes of what is in sight."""


@dataclass(frozen=True)
class _Sequence:
    """A sequence's detections, as the camera and as the plane has them, and the camera's way."""

    rows: FloatArray
    boxes: RecordedBoxes
    way: CameraWay
    starts: IntArray
    height_m: FloatArray


@dataclass
class _Box:
    """What a track's box is like apart from its place."""

    row: FloatArray
    heading_rad: float
    down_m: float
    step: int


def export(run: RecordedRun, folder: Path) -> list[Path]:
    """Write ``data_0/NNNN.txt`` for each sequence of the run, and ``score.py``, which has TrackEval score them.

    Raises:
        InputError: The run is not over KITTI tracking, or the recording is no longer where it was.
    """
    recording = run.config.traffic.recording
    if recording is None or recording.format != NAME or run.config.replay is None:
        raise InputError(f"`to` kitti: {run.folder} was not made from a {NAME} recording")
    least_score = least_score_of(NAME, recording.least_score)
    first = round(recording.start_s / STEP_S)
    read = [(files, _read(files, least_score)) for files in kitti.sequences(Path(run.config.replay))]
    played = [(files.labels.name, sequence) for files, sequence in read if len(sequence.way.shift) > first]
    if len(played) != run.truth["episode"].nunique():
        raise InputError(f"`to` kitti: {run.config.replay} has other sequences than when {run.folder} was made")
    (folder / "data_0").mkdir()
    written = []
    for episode, (name, sequence) in enumerate(played):
        begin = int(run.truth["step"][run.truth["episode"] == episode].min())
        own = run.reported[run.reported["episode"] == episode]
        lines = _lines(own.assign(step=own["step"] - begin + first), sequence)
        path = folder / "data_0" / name
        path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        written.append(path)
    return [*written, Path(shutil.copyfile(Path(__file__).with_name(SCRIPT), folder / SCRIPT_NAME))]


def _read(files: kitti.SequenceFiles, least_score: float) -> _Sequence:
    way = kitti.read_poses(files.poses)
    rows = kitti.of_vehicles(kitti.read_detections(files.detections))
    rows = rows[rows[:, kitti.SCORE] >= least_score]
    boxes = kitti.boxes_in_plane(files.detections, rows[:, 0], rows[:, kitti.BOX], way)
    place = (way.rotation[boxes.step] @ rows[:, kitti.BOX][:, 3:6, None])[:, :, 0] + way.shift[boxes.step]
    return _Sequence(rows, boxes, way, step_starts(boxes.step, len(way.shift)), place[:, 1])


def _lines(tracks: pd.DataFrame, sequence: _Sequence) -> list[str]:
    known: dict[int, _Box] = {}
    lines = []
    for key, now in tracks.groupby("step"):
        step = int(str(key))
        track_id = now["track_id"].to_numpy(dtype=np.int64)
        x, y = floats(now, "lon_m"), floats(now, "lat_m")
        begin, end = int(sequence.starts[step]), int(sequence.starts[step + 1])
        away = np.hypot(x[:, None] - sequence.boxes.x_m[begin:end], y[:, None] - sequence.boxes.y_m[begin:end])
        for track, row in zip(*pairs_within(away, GATE_M), strict=True):
            found = begin + int(row)
            before = known.get(int(track_id[track]))
            heading = float(sequence.boxes.heading_rad[found])
            if before is not None and abs(float(wrapped(np.array(heading - before.heading_rad)))) > 0.5 * np.pi:
                # Detectors take fronts for backs now and then; a vehicle does not turn round within a step.
                heading += np.pi
            known[int(track_id[track])] = _Box(sequence.rows[found], heading, float(sequence.height_m[found]), step)
        for track, number in enumerate(track_id.tolist()):
            box = known.get(number)
            if box is not None and (step - box.step) * STEP_S <= COASTED_S + 1e-9:
                lines.append(_line(step, number, box, (float(x[track]), float(y[track])), sequence.way))
    return lines


def _line(step: int, number: int, box: _Box, place: tuple[float, float], way: CameraWay) -> str:
    """Return KITTI's line of a track: its box in the camera's frame of the step."""
    x_right, z_ahead = -place[1], place[0]
    back = way.rotation[step].T
    centre = back @ (np.array([x_right, box.down_m, z_ahead]) - way.shift[step])
    front = back @ np.array([-np.sin(box.heading_rad), 0.0, np.cos(box.heading_rad)])
    turn = np.arctan2(-front[2], front[0])
    row = box.row
    numbers = [row[kitti.ANGLE], *row[kitti.PICTURE], *row[kitti.BOX][:3], *centre, turn, row[kitti.SCORE]]
    return f"{step} {number} Car 0 0 " + " ".join(f"{value:.6f}" for value in numbers)
